"""A campaign's folder: what was asked, and its trials in blocks, each file written whole.

`campaign.json` names the fixture, the sessions and the settings by their digests; `block-*.parquet`
hold 64 trials each, in the order of the trials. A later run with the same question goes on with
what is there; another question is refused.
"""

from __future__ import annotations

import hashlib
import json
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.campaign.settings import BLOCK, CampaignSettings
from vfplan.errors import InputError, OutputError, requires_extra
from vfplan.fixture import Fixture
from vfplan.io.files import read_whole
from vfplan.io.staging import write_whole
from vfplan.session import Session

FORMAT, VERSION, QUESTION = "vfplan-campaign", "1.0", "campaign.json"
MOST_BYTES = 2**26
NUMBERS = ("depth_m", "point", "force_n", "force_step_n")


def parquet() -> Any:
    """pyarrow.parquet, or the error that names the extra."""
    with requires_extra("campaigns need pyarrow", "campaign"):
        import pyarrow.parquet
    return pyarrow.parquet


def question(fixture: Fixture, sessions: list[Session], settings: CampaignSettings) -> dict:
    """What a campaign asks, as its folder keeps it: no names, no paths."""
    rendering, record, image = fixture.rendering, fixture.registration, fixture.image
    assert rendering is not None
    assert record is not None
    r, spacing = rendering, None if image is None else image.pixel_spacing_mm
    rest = (r.contact_radius, r.band, r.point_radius, r.max_iterations, record.model, spacing)
    held = hashlib.sha256(repr(rest).encode())
    for values in (fixture.points, fixture.sigma, r.stiffness, r.ignore_axis, record.T_robot_image):
        held.update(b"-" if values is None else np.ascontiguousarray(values, float).tobytes())
    least = min(settings.stiffness_range or rendering.stiffness)
    heard = [
        hashlib.sha256(np.ascontiguousarray(np.column_stack([s.time, s.hip])).data).hexdigest()
        for s in sessions
    ]
    return {
        "format": FORMAT,
        "version": VERSION,
        "block": BLOCK,
        "fixture_sha256": held.hexdigest(),
        "markers_sha256": markers_sha256(fixture),
        "session_sha256": heard,
        "share": float(least / (least + settings.hand_stiffness)),
        "settings": settings.as_dict(),
    }


def markers_sha256(fixture: Fixture) -> str:
    """Digest of a registration's model and markers, and of K: what a plan and its margin share."""
    assert fixture.registration is not None
    assert fixture.rendering is not None
    record = fixture.registration
    held = hashlib.sha256(record.model.encode())
    for values in (record.source, record.target, fixture.rendering.stiffness):
        held.update(np.ascontiguousarray(values, float).tobytes())
    return held.hexdigest()


class Store:
    """The folder of a campaign.

    folder: made where it is not there; its parent must be
    asked: what `question` gives
    Raises OutputError: the folder holds something else, or another question
    """

    def __init__(self, folder: Path, asked: dict[str, Any]) -> None:
        self.folder = folder
        wanted = json.loads(json.dumps(asked))
        if not folder.exists():
            try:
                folder.mkdir()
            except OSError as error:
                raise OutputError(error.strerror or str(error), where=str(folder)) from None
        if not (folder / QUESTION).exists():
            if not folder.is_dir() or any(p.name[:8] != ".vfplan-" for p in folder.iterdir()):
                raise OutputError("is no campaign's folder, and not empty", where=str(folder))
            text = json.dumps(wanted, indent=2) + "\n"
            write_whole(folder / QUESTION, [text.encode()], overwrite=False)
            return
        found = asked_in(folder)
        differing = sorted(k for k in wanted.keys() | found if wanted.get(k) != found.get(k))
        if differing:
            raise OutputError(
                f"holds a campaign that differs in {', '.join(differing)}; another folder wanted",
                where=str(folder),
            )

    def path(self, block: int) -> Path:
        """The file of a block."""
        return self.folder / f"block-{block:08d}.parquet"

    def missing(self, blocks: int) -> list[int]:
        """Which of the first `blocks` blocks are to be made; raises where one is damaged."""
        missing = []
        for k in range(blocks):
            if self.path(k).exists():
                _block(self.path(k), k)
            else:
                missing.append(k)
        return missing

    def keep(self, block: int, rows: list[dict[str, Any]]) -> None:
        """Write a block, whole; the same block again is left as it is, being the same."""
        import pyarrow

        held = BytesIO()
        parquet().write_table(pyarrow.Table.from_pylist(rows), held)
        if not self.path(block).exists():
            write_whole(self.path(block), [held.getvalue()], overwrite=True)


def read_campaign(folder: Path, trials: int | None = None) -> tuple[dict, dict[str, NDArray]]:
    """What a campaign asked, and its trials as columns, in order.

    Parameters
    ----------
    folder
        Of `vfplan campaign -o`.
    trials
        How many of the first ones; `None`: all that are there without a gap.

    Raises
    ------
    InputError
        No campaign is there, a block is damaged, or there are fewer trials.
    """
    asked = asked_in(folder)
    columns: dict[str, list[NDArray]] = {}
    count, block = 0, 0
    while trials is None or count < trials:
        path = folder / f"block-{block:08d}.parquet"
        if not path.exists():
            break
        table = _block(path, block)
        for name, values in table.items():
            columns.setdefault(name, []).append(values)
        count, block = count + len(table["trial"]), block + 1
    if not count or (trials is not None and count < trials):
        wanted = f"; {trials} are wanted" if trials else ""
        raise InputError(f"holds {count} trials{wanted}", where=str(folder))
    return asked, {name: np.concatenate(parts)[:trials] for name, parts in columns.items()}


def asked_in(folder: Path) -> dict[str, Any]:
    """What a campaign's folder says that it asks; raises `InputError`."""
    data = read_whole(folder / QUESTION, MOST_BYTES)
    try:
        found = json.loads(data)
        good = found["format"] == FORMAT and found["version"] == VERSION
        good = good and 0 < found["share"] < 1 and isinstance(found["markers_sha256"], str)
    except (ValueError, KeyError, TypeError, RecursionError):
        good = False
    if not good:
        raise InputError(f"is no {FORMAT} of version {VERSION}", where=str(folder / QUESTION))
    return found


def _block(path: Path, block: int) -> dict[str, NDArray]:
    import pyarrow

    data = read_whole(path, MOST_BYTES)
    try:
        table = parquet().read_table(BytesIO(data))
        found = {name: table.column(name).to_numpy() for name in table.column_names}
        trials = found["trial"]
        if not all(np.isfinite(found[name]).all() for name in NUMBERS):
            raise ValueError
    except (pyarrow.ArrowException, OSError, KeyError, TypeError, ValueError):
        raise InputError("is a damaged block; remove it to have it made anew",
                         where=str(path)) from None  # fmt: skip
    first = block * BLOCK
    if not np.array_equal(trials, np.arange(first, first + BLOCK)):
        raise InputError(f"does not hold trials {first} to {first + BLOCK - 1}", where=str(path))
    return found
