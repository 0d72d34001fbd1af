"""A campaign's blocks, made on this machine's cores or on a Dask cluster: the same bits."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import as_completed as first_done
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from vfplan.campaign.settings import BLOCK, CampaignSettings
from vfplan.campaign.store import Store, parquet, question
from vfplan.campaign.trial import Trials
from vfplan.errors import InputError, SettingError, requires_extra
from vfplan.fixture import Fixture
from vfplan.io.processes import worker_processes as processes
from vfplan.session import Session

Rows = list[dict[str, Any]]
_of_this_process: Trials | None = None


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
    """Make the trials that `folder` does not hold yet; how many were made.

    Whole blocks of 64 trials are made: at least `trials` of them stand in the folder afterwards.
    Which process made a block leaves no trace in it.

    Parameters
    ----------
    workers
        Processes on this machine, without `scheduler`.
    scheduler
        Address of a Dask scheduler, e.g. "tcp://127.0.0.1:8786".
    done
        Told of each number of trials just made.

    Raises
    ------
    SceneError, SettingError, OutputError
        Nothing to vary, a setting out of range, or a folder of another campaign.
    MissingExtra
        Without pyarrow, or without distributed where a scheduler is given.
    """
    parquet()
    if trials < 1 or workers < 1:
        raise SettingError(f"trials {trials}, workers {workers}: at least 1 of each is wanted")
    if not sessions:
        raise SettingError("no session: at least one is wanted")
    made = Trials(fixture, sessions, settings or CampaignSettings())
    store = Store(folder, question(fixture, sessions, made.settings))
    missing = store.missing(-(-trials // BLOCK))
    with _blocks(made, missing, workers, scheduler) as blocks:
        for block, rows in blocks:
            store.keep(block, rows)
            done(len(rows))
    return len(missing) * BLOCK


def make_block(trials: Trials, block: int) -> Rows:
    """The rows of a block; any process gives the same."""
    return [trials.run(k) for k in range(block * BLOCK, (block + 1) * BLOCK)]


@contextmanager
def _blocks(
    trials: Trials, missing: list[int], workers: int, scheduler: str | None
) -> Iterator[Iterator[tuple[int, Rows]]]:
    if scheduler is not None and missing:
        with _cluster(trials, missing, scheduler) as found:
            yield found
    elif workers == 1 or len(missing) < 2:
        yield ((block, make_block(trials, block)) for block in missing)
    else:
        with processes(workers, _take, trials) as pool:
            futures = {pool.submit(_block_here, block): block for block in missing}
            yield ((futures[f], f.result()) for f in first_done(futures))


def _take(trials: Trials) -> None:
    global _of_this_process
    _of_this_process = trials


def _block_here(block: int) -> Rows:
    assert _of_this_process is not None
    return make_block(_of_this_process, block)


@contextmanager
def _cluster(
    trials: Trials, missing: list[int], scheduler: str
) -> Iterator[Iterator[tuple[int, Rows]]]:
    """On a Dask cluster; a worker that dies has its blocks made by another."""
    with requires_extra("--scheduler needs dask", "campaign"):
        from distributed import Client, as_completed
    try:
        client = Client(scheduler, timeout="20s", set_as_default=False)
    except (OSError, ValueError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(f"no Dask scheduler answers: {reason}", where=scheduler) from None
    with client, client.as_current():
        # hash=False: the data of two campaigns never count as one.
        held = client.scatter(trials, broadcast=True, hash=False)
        futures = {
            client.submit(make_block, held, block, pure=False, retries=4): block
            for block in missing
        }
        yield ((futures[f], rows) for f, rows in as_completed(futures, with_results=True))
