"""The folder of a campaign: its question, its trials in blocks, and what they say together.

`campaign.json` names the fixture, the sessions and the settings by their digests; `block-*.parquet`
hold 64 trials each, in the order of the trials. A later run with the same question continues there;
another question is refused.

Blocks are made on this machine's cores or on a Dask cluster: the same bits. Probabilities,
quantiles and margins have their 95 % intervals; `plan --margin p=P --campaign DIR` takes its margin
from here.
"""

from __future__ import annotations

import hashlib
import json
import pickle
from collections.abc import Iterator
from concurrent.futures import Executor, as_completed
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import lru_cache
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.bundle import review_digest
from vfplan.campaign.trial import BLOCK, CampaignSettings, Trials
from vfplan.display import Advance, Report
from vfplan.errors import CheckFailed, InputError, OutputError, requires_extra
from vfplan.fixture import Fixture
from vfplan.geometry.lines import Array
from vfplan.io.files import MAX_SETTINGS_BYTES, MAX_TEXT_BYTES, read_whole, to_json_types
from vfplan.io.sandbox import worker_processes
from vfplan.io.writing import write_whole
from vfplan.palette import CLOUD
from vfplan.registration.registration import PROBABILITY
from vfplan.session.session import Session

FORMAT = "vfplan-campaign"
VERSION = "1.0"
QUESTION_FILE = "campaign.json"
# What the trials of a folder answer.
Question = dict[str, Any]

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
) -> Question:
    """The question of a campaign, as its folder keeps it: no names, no paths."""
    plan = review_digest(replace(fixture, findings=(), reviewed=None, case=None))
    spacing = getattr(fixture.image, "pixel_spacing_mm", None)
    digest = hashlib.sha256(repr((plan, spacing)).encode())
    if fixture.sigma is not None:
        digest.update(fixture.sigma.tobytes())
    softest = min(settings.stiffness_range or fixture.stiffness)
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
        "settings": {name: value for name, value in vars(settings).items() if value is not None},
    }


def markers_sha256(fixture: Fixture) -> str:
    """Digest of a registration's model and markers, and of K: what a plan and its margin share."""
    record = fixture.registration
    digest = hashlib.sha256(record.model.encode())
    for values in (record.source, record.target, fixture.rendering.stiffness):
        digest.update(np.ascontiguousarray(values, float).tobytes())
    return digest.hexdigest()


def open_folder(folder: Path, question: Question) -> None:
    """Make the folder of a campaign, or check that it holds this question.

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
    try:
        folder.mkdir(exist_ok=True)
    except FileExistsError:
        text = "is a file. Name a folder"
        raise OutputError(text, where=folder, code="folder-is-a-file") from None
    except OSError as error:
        text = f"cannot be made: {error.strerror or error}. Name another folder"
        raise OutputError(text, where=folder, code="folder-not-made") from None
    if not (folder / QUESTION_FILE).exists():
        # Files that another process is just writing have this prefix.
        if any(not path.name.startswith(".vfplan-") for path in folder.iterdir()):
            text = "is no campaign's folder, and not empty. Name another folder"
            raise OutputError(text, where=folder, code="folder-not-empty")
        text = json.dumps(question, indent=2) + "\n"
        write_whole(folder / QUESTION_FILE, [text.encode()], overwrite=False)
        return
    question, stored = json.loads(json.dumps(question)), read_question(folder)
    names = sorted(question.keys() | stored)
    differing = [name for name in names if question.get(name) != stored.get(name)]
    if differing:
        text = f"holds a campaign that differs in {', '.join(differing)}. Name another folder"
        raise OutputError(text, where=folder, code="another-campaign")


def store_block(path: Path, rows: list[Report]) -> None:
    """Write a block, whole; one that is there already is the same, and stays."""
    import pyarrow

    buffer = BytesIO()
    parquet().write_table(pyarrow.Table.from_pylist(rows), buffer)
    if not path.exists():
        write_whole(path, [buffer.getvalue()], overwrite=True)


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
    columns = {}
    count = block = 0
    while (trials is None or count < trials) and (path := block_path(folder, block)).exists():
        for name, values in read_block(path, block).items():
            columns.setdefault(name, []).append(values)
        block += 1
        count = block * BLOCK
    if not count or (trials is not None and count < trials):
        raise InputError(
            f"holds {count} trials of {trials or 'any'}. Make more with vfplan campaign",
            where=folder, code="too-few-trials", numbers={"trials": count, "wanted": trials},
        )  # fmt: skip
    return question, {name: np.concatenate(parts)[:trials] for name, parts in columns.items()}


def read_question(folder: Path) -> Question:
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
            where=path, code="no-campaign",
        )  # fmt: skip
    return question


def read_block(path: Path, block: int) -> dict[str, NDArray]:
    """The trials of a block as columns; raises `InputError` for a damaged one."""
    import pyarrow

    data = read_whole(path, MAX_BLOCK_BYTES)
    try:
        table = parquet().read_table(BytesIO(data))
        columns = {name: table.column(name).to_numpy() for name in table.column_names}
        first = block * BLOCK
        is_whole = np.array_equal(columns["trial"], np.arange(first, first + BLOCK))
        if not is_whole or not all(np.isfinite(columns[name]).all() for name in NUMBERS):
            raise ValueError
    except (pyarrow.ArrowException, OSError, KeyError, TypeError, ValueError):
        raise InputError(
            "is a damaged block. Remove it to have it made anew", where=path, code="damaged-block"
        ) from None
    return columns


def run_campaign(
    fixture: Fixture,
    sessions: list[Session],
    folder: Path,
    trials: int,
    settings: CampaignSettings,
    *,
    workers: int = 1,
    scheduler: str | None = None,
    done: Advance = lambda trials: None,
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
    SceneError, OutputError
        Nothing to vary, or a folder of another campaign.
    MissingExtra
        Without pyarrow, or without distributed where a scheduler is given.
    """
    parquet()
    campaign = Trials(fixture, sessions, settings)
    open_folder(folder, campaign_question(fixture, sessions, campaign.settings))
    paths = [block_path(folder, block) for block in range(-(-trials // BLOCK))]
    missing = [block for block, path in enumerate(paths) if not path.exists()]
    for block in range(len(paths)):
        if block not in missing:
            read_block(paths[block], block)
    data: Any = pickle.dumps(campaign)
    if scheduler is None and min(workers, len(missing)) < 2:
        for block in missing:
            store_block(paths[block], make_block(data, block))
            done(BLOCK)
        return len(missing) * BLOCK
    with ExitStack() as stack:
        if scheduler is None:
            executor = stack.enter_context(worker_processes(workers))
        else:
            executor, data = stack.enter_context(workers_of_cluster(scheduler, data))
        futures = {executor.submit(make_block, data, block): block for block in missing}
        for future in as_completed(futures):
            store_block(paths[futures[future]], future.result())
            done(BLOCK)
    return len(missing) * BLOCK


def make_block(trials: bytes, block: int) -> list[Report]:
    """The rows of a block; any process makes the same, and keeps the trials that it unpacked."""
    unpacked = loads_once(trials)
    return [unpacked.run(trial) for trial in range(block * BLOCK, (block + 1) * BLOCK)]


loads_once = lru_cache(maxsize=1)(pickle.loads)


@contextmanager
def workers_of_cluster(scheduler: str, trials: bytes) -> Iterator[tuple[Executor, Any]]:
    """The workers of a Dask cluster, and the trials, sent to each of them.

    Where a worker dies, another makes its blocks.
    """
    with requires_extra("--scheduler needs dask", "campaign"):
        from distributed import Client
    try:
        client = Client(scheduler, timeout="20s", set_as_default=False)
    except (OSError, ValueError) as error:
        reason, *_ = str(error).splitlines() or [type(error).__name__]
        raise InputError(
            f"no Dask scheduler answers: {reason}. Check the address", where=scheduler,
            code="no-scheduler",
        ) from None  # fmt: skip
    with client:
        # Without hash=False the data of two campaigns could count as one.
        sent = client.scatter(trials, broadcast=True, hash=False)
        yield client.get_executor(pure=False, retries=4), sent


def quantile(sorted_values: Array, q: float) -> Array:
    """(3,) a quantile, and its interval from order statistics; NaN: an end that no trial bounds.

    H. A. David, H. N. Nagaraja, Order Statistics, 3rd edition, Wiley 2003, 7.1.
    """
    from scipy.stats import quantile_test

    index = max(0, int(np.ceil(q * len(sorted_values))) - 1)
    ends = quantile_test(sorted_values, p=q).confidence_interval(PROBABILITY)
    return np.array([sorted_values[index], *ends])


def entering(depth: Array, beyond_m: list[float]) -> list[dict[str, float]]:
    """How probable it is to go further than each of `beyond_m` beyond the true curve.

    With exact intervals: C. J. Clopper, E. S. Pearson, Biometrika 26, 1934, 404-413.
    """
    from scipy.stats import binomtest

    entries = []
    for beyond in beyond_m:
        test = binomtest(int((depth > beyond).sum()), len(depth))
        low, high = map(float, test.proportion_ci(PROBABILITY, method="exact"))
        entries.append({"beyond_mm": 1e3 * beyond, "p": test.statistic, "low": low, "high": high})
    return entries


def margins(
    depth: Array, probabilities: list[float], share: float
) -> list[dict[str, float | None]]:
    """The margin [mm] that makes entering less probable than each of the probabilities.

    A margin moves the rendered surface outwards, and the tool by `share` = K / (K + k_h) of that.
    So the margin for p is the (1 - p) quantile of the depth over this share, not less than 0.
    """
    entries = []
    for probability in probabilities:
        margins_mm = 1e3 * np.maximum(0.0, quantile(np.sort(depth), 1 - probability)) / share
        margin, low, high = to_json_types(margins_mm)
        entries.append({"p": probability, "margin_mm": margin, "low": low, "high": high})
    return entries


def summary(
    question: Question, table: dict[str, Array], beyond_m: list[float], probabilities: list[float]
) -> Report:
    """What `vfplan campaign --json` says of the question and the trials of `read_campaign`."""
    depth = table["depth_m"]
    quantiles_mm = {}
    for q in (0.5, 0.9, 0.95, 0.99):
        numbers = to_json_types(1e3 * quantile(np.sort(depth), q))
        quantiles_mm[f"{q:g}"] = dict(zip(("value", "low", "high"), numbers, strict=True))
    return {
        "trials": len(depth),
        "trials_in_contact": int((table["point"] >= 0).sum()),
        "settings": question["settings"],
        "p_enter": entering(depth, beyond_m),
        "margin_for": margins(depth, probabilities, question["share"]),
        "depth_quantiles_mm": quantiles_mm,
        "force_max_n": float(table["force_n"].max()),
        "force_step_max_n": float(table["force_step_n"].max()),
    }


# Number of trials times p from which the 95 % interval of a (1 - p) quantile has an upper end.
TRIALS_TIMES_P = 3.7


def require_same_plan(folder: Path, fixture: Fixture) -> None:
    """Refuse a margin of a campaign on other markers, another model or another K.

    Raises
    ------
    InputError, CheckFailed
        No campaign, or one of another plan.
    """
    if read_question(folder)["markers_sha256"] != markers_sha256(fixture):
        raise CheckFailed(
            "is a campaign of another plan: its markers, model or stiffness differ. Run "
            "vfplan campaign on this plan",
            where=folder, code="campaign-of-another-plan",
        )  # fmt: skip


def margin_for(folder: Path, p: float) -> float:
    """The margin [m] that makes entering less probable than `p`, to its interval's upper end.

    Raises
    ------
    InputError
        No campaign, or a damaged one.
    CheckFailed
        Too few trials to bound the margin from above.
    """
    question, table = read_campaign(folder)
    trials = len(table["depth_m"])
    high_mm = margins(table["depth_m"], [p], question["share"])[0]["high"]
    if high_mm is None:
        needed = round(TRIALS_TIMES_P / p)
        raise CheckFailed(
            f"holds {trials} trials, which do not bound the margin for p = {p:g} from above. "
            f"Make about {needed}",
            where=folder, code="too-few-trials", numbers={"trials": trials, "needed": needed},
        )  # fmt: skip
    return 1e-3 * high_mm


def draw_campaign(fixture: Fixture, table: dict[str, Array], beyond_m: float, path: Path) -> None:
    """Write the curve in its plane, with a disc wherever the tool entered: the more, the larger.

    Parameters
    ----------
    fixture
        In `robot_base`.
    table
        The trials, of `read_campaign`.
    beyond_m
        The depth beyond the true curve [m] from which on the tool has entered.
    """
    from vfplan.figures.style import save_png, subplots

    point = table["point"].astype(int)
    entered = (table["depth_m"] > beyond_m) & (point >= 0)
    share = np.bincount(point[entered], minlength=len(fixture.points)) / len(entered)
    centred = fixture.points - fixture.points.mean(axis=0)
    flat = 1e3 * centred @ np.linalg.svd(centred, full_matrices=False)[2][:2].T
    figure, axes = subplots(7.0, 3.6)
    axes.plot(*flat.T, ".", ms=1.5, color=CLOUD, alpha=0.5)
    hit = share > 0
    discs = axes.scatter(*flat[hit].T, s=300 * share[hit] / max(share.max(), 1e-12), c=share[hit],
                         cmap="autumn_r", vmin=0, alpha=0.6, lw=0)  # fmt: skip
    figure.colorbar(discs, ax=axes, label="probability", shrink=0.7)
    axes.margins(0.1)
    title = f"where the tool is over {1e3 * beyond_m:g} mm beyond"
    axes.set(aspect="equal", xlabel="mm", ylabel="mm", title=title)
    save_png(figure, path)
