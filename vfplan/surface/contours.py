"""What every reader gives: closed rings in the patient, each flat, and which slices hold none."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import InputError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Structure:
    """One of the structures that a source holds."""

    number: int  # as the source numbers it
    name: str = ""  # as the source names it; empty where it does not


@dataclass(frozen=True, eq=False)
class Contours:
    """One structure as a stack of outlines."""

    rings: tuple[Array, ...]  # each (M, 3), patient LPS [m], its last corner joined to its first
    structures: tuple[Structure, ...]  # all structures of the source
    chosen: int  # the number of this one
    inputs: dict[str, str]  # role -> SHA-256 of the source's bytes
    # (3,) unit normal of the slices where the source says it; `None`: what the rings say
    normal: Array | None = None
    # (E, 3) a point of each slice that is known to show nothing of the structure
    empty: Array = field(default_factory=lambda: np.empty((0, 3)))
    told: tuple[str, ...] = ()  # what a person should know


def choose_structure(structures: tuple[Structure, ...], asked: str | None) -> Structure:
    """The structure that is asked for by its name or number, or the only one.

    Raises `InputError` where there is none, or several and none or an unknown one was asked for.
    """
    named = ", ".join(f"{s.number} {s.name!r}" if s.name else str(s.number) for s in structures)
    if not structures:
        raise InputError("holds no structure.")
    if asked is None:
        if len(structures) > 1:
            raise InputError(
                f"holds {len(structures)} structures: {named}. Choose one (--structure)."
            )
        return structures[0]
    found = [s for s in structures if asked == s.name]
    found = found or [s for s in structures if asked == str(s.number)]
    if len(found) != 1:
        how = "several structures of that name" if found else "no such structure"
        raise InputError(f"{how}. It holds {named}.")
    return found[0]
