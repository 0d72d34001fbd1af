"""The blocks of a campaign, made on this machine's cores or on a Dask cluster: the same bits."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import as_completed
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from vfplan.campaign.settings import BLOCK, CampaignSettings
from vfplan.campaign.store import Store, campaign_question, parquet
from vfplan.campaign.trial import Trials
from vfplan.errors import InputError, SettingError, requires_extra
from vfplan.fixture import Fixture
from vfplan.io.processes import worker_processes as processes
from vfplan.session import Session

Rows = list[dict[str, Any]]

_trials_of_this_process: Trials | None = None
"""The trials of a worker process, which are sent to it once and not with each block."""


def run_campaign(
    fixture: Fixture,
    sessions: list[Session],
    folder: Path,
    trials: int,
    settings: CampaignSettings | None = None,
    *,
    workers: int = 1,
    scheduler: str | None = None,
    done: Callable[[int], None] = lambda trials: None,
) -> int:
    """Make the trials that `folder` does not hold yet; returns how many were made.

    Whole blocks of 64 trials are made: at least `trials` of them stand in the folder afterwards.
    Which process made a block leaves no trace in it.

    Parameters
    ----------
    workers
        Processes on this machine, without `scheduler`.
    scheduler
        Address of a Dask scheduler, e.g. "tcp://127.0.0.1:8786".
    done
        Called with each number of trials just made.

    Raises
    ------
    SceneError, SettingError, OutputError
        Nothing to vary, a setting out of range, or a folder of another campaign.
    MissingExtra
        Without pyarrow, or without distributed where a scheduler is given.
    """
    parquet()
    if trials < 1 or workers < 1:
        raise SettingError(
            f"there are {trials} trials and {workers} workers. Give at least 1 of each",
            code="no-trials",
        )
    if not sessions:
        raise SettingError("there is no session. Give at least one", code="no-session")
    campaign = Trials(fixture, sessions, settings or CampaignSettings())
    store = Store(folder, campaign_question(fixture, sessions, campaign.settings))
    block_count = -(-trials // BLOCK)
    missing = store.missing(block_count)
    if scheduler is not None and missing:
        source = blocks_on_cluster(campaign, missing, scheduler)
    elif workers > 1 and len(missing) > 1:
        source = blocks_in_processes(campaign, missing, workers)
    else:
        source = blocks_here(campaign, missing)
    with source as blocks:
        for block, rows in blocks:
            store.store_block(block, rows)
            done(len(rows))
    return len(missing) * BLOCK


def make_block(trials: Trials, block: int) -> Rows:
    """The rows of a block; any process makes the same."""
    return [trials.run(trial) for trial in range(block * BLOCK, (block + 1) * BLOCK)]


@contextmanager
def blocks_here(trials: Trials, missing: list[int]) -> Iterator[Iterator[tuple[int, Rows]]]:
    """The blocks one after the other, in this process."""
    yield ((block, make_block(trials, block)) for block in missing)


@contextmanager
def blocks_in_processes(
    trials: Trials, missing: list[int], workers: int
) -> Iterator[Iterator[tuple[int, Rows]]]:
    """The blocks from processes of this machine, as they are ready."""
    with processes(workers, set_trials_of_process, trials) as pool:
        futures = {pool.submit(make_block_of_process, block): block for block in missing}
        yield ((futures[future], future.result()) for future in as_completed(futures))


def set_trials_of_process(trials: Trials) -> None:
    """Keep the trials for the blocks that this worker process will make."""
    global _trials_of_this_process
    _trials_of_this_process = trials


def make_block_of_process(block: int) -> Rows:
    """The rows of a block, of the trials that this worker process keeps."""
    assert _trials_of_this_process is not None
    return make_block(_trials_of_this_process, block)


@contextmanager
def blocks_on_cluster(
    trials: Trials, missing: list[int], scheduler: str
) -> Iterator[Iterator[tuple[int, Rows]]]:
    """The blocks from a Dask cluster; where a worker dies, another makes its blocks."""
    with requires_extra("--scheduler needs dask", "campaign"):
        from distributed import Client
        from distributed import as_completed as completed_on_cluster
    try:
        client = Client(scheduler, timeout="20s", set_as_default=False)
    except (OSError, ValueError) as error:
        reason = type(error).__name__
        if str(error):
            reason = str(error).splitlines()[0]
        raise InputError(
            f"no Dask scheduler answers: {reason}. Check the address", where=scheduler,
            code="no-scheduler",
        ) from None  # fmt: skip
    with client, client.as_current():
        # Without hash=False the data of two campaigns could count as one.
        scattered = client.scatter(trials, broadcast=True, hash=False)
        futures = {}
        for block in missing:
            future = client.submit(make_block, scattered, block, pure=False, retries=4)
            futures[future] = block
        results = completed_on_cluster(futures, with_results=True)
        yield ((futures[future], rows) for future, rows in results)
