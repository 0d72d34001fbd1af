"""The folder of a campaign: its question, and its trials in blocks, each file written whole.

`campaign.json` names the fixture, the sessions and the settings by their digests; `block-*.parquet`
hold 64 trials each, in the order of the trials. A later run with the same question continues there;
another question is refused.

Blocks are made on this machine's cores or on a Dask cluster: the same bits.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator
from concurrent.futures import as_completed
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.campaign.trial import BLOCK, CampaignSettings, Trials
from vfplan.errors import InputError, OutputError, SettingError, requires_extra
from vfplan.fixture import Fixture
from vfplan.io.files import MAX_SETTINGS_BYTES, MAX_TEXT_BYTES, read_whole
from vfplan.io.sandbox import worker_processes as processes
from vfplan.io.writing import write_whole
from vfplan.session.session import Session

FORMAT = "vfplan-campaign"
VERSION = "1.0"
QUESTION_FILE = "campaign.json"
# Largest size of a block of trials that is read. One of 64 trials is a thousandth of it.
MAX_BLOCK_BYTES = MAX_TEXT_BYTES // 4
NUMBERS = ("depth_m", "point", "force_n", "force_step_n")


def parquet() -> Any:
    """pyarrow.parquet, or the error that names the extra."""
    with requires_extra("campaigns need pyarrow", "campaign"):
        import pyarrow.parquet
    return pyarrow.parquet


def campaign_question(
    fixture: Fixture, sessions: list[Session], settings: CampaignSettings
) -> dict[str, Any]:
    """The question of a campaign, as its folder keeps it: no names, no paths."""
    rendering = fixture.rendering
    record = fixture.registration
    assert rendering is not None
    assert record is not None
    spacing = fixture.image.pixel_spacing_mm if fixture.image is not None else None
    numbers = (
        rendering.contact_radius, rendering.band, rendering.point_radius,
        rendering.max_iterations, record.model, spacing,
    )  # fmt: skip
    digest = hashlib.sha256(repr(numbers).encode())
    for values in (
        fixture.points, fixture.sigma, rendering.stiffness, rendering.ignore_axis,
        record.T_robot_image,
    ):  # fmt: skip
        digest.update(b"-" if values is None else np.ascontiguousarray(values, float).tobytes())
    softest = min(settings.stiffness_range or rendering.stiffness)
    return {
        "format": FORMAT,
        "version": VERSION,
        "block": BLOCK,
        "fixture_sha256": digest.hexdigest(),
        "markers_sha256": markers_sha256(fixture),
        "session_sha256": [
            hashlib.sha256(np.column_stack([session.time, session.hip]).tobytes()).hexdigest()
            for session in sessions
        ],
        "share": float(softest / (softest + settings.hand_stiffness)),
        "settings": settings.as_dict(),
    }


def markers_sha256(fixture: Fixture) -> str:
    """Digest of a registration's model and markers, and of K: what a plan and its margin share."""
    assert fixture.registration is not None
    assert fixture.rendering is not None
    record = fixture.registration
    digest = hashlib.sha256(record.model.encode())
    for values in (record.source, record.target, fixture.rendering.stiffness):
        digest.update(np.ascontiguousarray(values, float).tobytes())
    return digest.hexdigest()


class Store:
    """The folder of a campaign.

    Parameters
    ----------
    folder
        It is made where there is none; its parent must exist.
    question
        As `campaign_question` gives it.

    Raises
    ------
    OutputError
        The folder holds something else, or another question.
    """

    def __init__(self, folder: Path, question: dict[str, Any]) -> None:
        self.folder = folder
        question = json.loads(json.dumps(question))
        if not folder.exists():
            try:
                folder.mkdir()
            except OSError as error:
                reason = error.strerror or str(error)
                raise OutputError(
                    f"cannot be made: {reason}. Name another folder",
                    where=str(folder),
                    code="folder-not-made",
                ) from None
        if not (folder / QUESTION_FILE).exists():
            if not folder.is_dir():
                raise OutputError(
                    "is a file. Name a folder", where=str(folder), code="folder-is-a-file"
                )
            for path in folder.iterdir():
                # Files that another process is just writing have this prefix.
                if not path.name.startswith(".vfplan-"):
                    raise OutputError(
                        "is no campaign's folder, and not empty. Name another folder",
                        where=str(folder), code="folder-not-empty",
                    )  # fmt: skip
            text = json.dumps(question, indent=2) + "\n"
            write_whole(folder / QUESTION_FILE, [text.encode()], overwrite=False)
            return
        stored = read_question(folder)
        names = sorted(question.keys() | stored)
        differing = [name for name in names if question.get(name) != stored.get(name)]
        if differing:
            raise OutputError(
                f"holds a campaign that differs in {', '.join(differing)}. Name another folder",
                where=str(folder), code="another-campaign",
            )  # fmt: skip

    def path(self, block: int) -> Path:
        """The file of a block."""
        return block_path(self.folder, block)

    def missing(self, block_count: int) -> list[int]:
        """Which of the first blocks are to be made; raises `InputError` where one is damaged."""
        missing = [block for block in range(block_count) if not self.path(block).exists()]
        for block in sorted(set(range(block_count)) - set(missing)):
            read_block(self.path(block), block)
        return missing

    def store_block(self, block: int, rows: list[dict[str, Any]]) -> None:
        """Write a block, whole; one that is there already is the same, and stays."""
        import pyarrow

        buffer = BytesIO()
        parquet().write_table(pyarrow.Table.from_pylist(rows), buffer)
        if not self.path(block).exists():
            write_whole(self.path(block), [buffer.getvalue()], overwrite=True)


def block_path(folder: Path, block: int) -> Path:
    """The file of a block in a campaign's folder."""
    return folder / f"block-{block:08d}.parquet"


def read_campaign(folder: Path, trials: int | None = None) -> tuple[dict, dict[str, NDArray]]:
    """The question of a campaign, and its trials as columns, in order.

    Parameters
    ----------
    folder
        Of `vfplan campaign -o`.
    trials
        How many of the first ones; `None`: all that are there without a gap.

    Raises
    ------
    InputError
        No campaign, a damaged block, or fewer trials than are wanted.
    """
    question = read_question(folder)
    columns: dict[str, list[NDArray]] = {}
    count = block = 0
    while (trials is None or count < trials) and (path := block_path(folder, block)).exists():
        for name, values in read_block(path, block).items():
            columns.setdefault(name, []).append(values)
        block += 1
        count = block * BLOCK
    if not count or (trials is not None and count < trials):
        raise InputError(
            f"holds {count} trials of {trials or 'any'}. Make more with vfplan campaign",
            where=str(folder), code="too-few-trials", numbers={"trials": count, "wanted": trials},
        )  # fmt: skip
    joined = {name: np.concatenate(parts)[:trials] for name, parts in columns.items()}
    return question, joined


def read_question(folder: Path) -> dict[str, Any]:
    """The question that a campaign's folder holds; raises `InputError`."""
    path = folder / QUESTION_FILE
    data = read_whole(path, MAX_SETTINGS_BYTES)
    try:
        question = json.loads(data)
        is_sound = (
            question["format"] == FORMAT
            and question["version"] == VERSION
            and 0 < question["share"] < 1
            and isinstance(question["markers_sha256"], str)
        )
    except (ValueError, KeyError, TypeError, RecursionError):
        is_sound = False
    if not is_sound:
        raise InputError(
            f"is no {FORMAT} of version {VERSION}. Name the folder of vfplan campaign",
            where=str(path), code="no-campaign",
        )  # fmt: skip
    return question


def read_block(path: Path, block: int) -> dict[str, NDArray]:
    """The trials of a block as columns; raises `InputError` for a damaged one."""
    import pyarrow

    data = read_whole(path, MAX_BLOCK_BYTES)
    try:
        table = parquet().read_table(BytesIO(data))
        columns = {name: table.column(name).to_numpy() for name in table.column_names}
        trials = columns["trial"]
        if not all(np.isfinite(columns[name]).all() for name in NUMBERS):
            raise ValueError
    except (pyarrow.ArrowException, OSError, KeyError, TypeError, ValueError):
        raise InputError(
            "is a damaged block. Remove it to have it made anew", where=str(path),
            code="damaged-block",
        ) from None  # fmt: skip
    first = block * BLOCK
    if not np.array_equal(trials, np.arange(first, first + BLOCK)):
        raise InputError(
            f"does not hold trials {first} to {first + BLOCK - 1}. Remove it to have it made anew",
            where=str(path), code="damaged-block",
        )  # fmt: skip
    return columns


Rows = list[dict[str, Any]]

# The trials of a worker process, which are sent to it once and not with each block.
_trials_of_this_process: Trials | None = None


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
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(
            f"no Dask scheduler answers: {reason}. Check the address", where=scheduler,
            code="no-scheduler",
        ) from None  # fmt: skip
    with client, client.as_current():
        # Without hash=False the data of two campaigns could count as one.
        scattered = client.scatter(trials, broadcast=True, hash=False)
        futures = {
            client.submit(make_block, scattered, block, pure=False, retries=4): block
            for block in missing
        }
        results = completed_on_cluster(futures, with_results=True)
        yield ((futures[future], rows) for future, rows in results)
