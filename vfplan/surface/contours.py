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

    number: int
    """As the source numbers it."""
    name: str = ""
    """As the source names it; empty where it does not."""


@dataclass(frozen=True, eq=False)
class Contours:
    """One structure as a stack of outlines."""

    rings: tuple[Array, ...]
    """Each (M, 3), patient LPS [m], its last corner joined to its first."""
    structures: tuple[Structure, ...]
    """All structures of the source."""
    chosen: int
    """The number of this one."""
    inputs: dict[str, str]
    """Role -> SHA-256 of the source's bytes."""
    normal: Array | None = None
    """(3,) unit normal of the slices where the source states it; `None`: what the rings give."""
    empty: Array = field(default_factory=lambda: np.empty((0, 3)))
    """(E, 3) a point of each slice that is known to show nothing of the structure."""
    remarks: tuple[str, ...] = ()
    """What a person should know."""


def choose_structure(structures: tuple[Structure, ...], wanted: str | None) -> Structure:
    """The structure of this name or number; without one the only structure.

    Raises `InputError` where there is none, or several and `wanted` is `None` or fits not one.
    """
    if not structures:
        raise InputError(
            "holds no structure. Give a file in which one is outlined.", code="structure-none"
        )
    names = []
    for structure in structures:
        if structure.name:
            names.append(f"{structure.number} {structure.name!r}")
        else:
            names.append(str(structure.number))
    listed = ", ".join(names)
    if wanted is None:
        if len(structures) > 1:
            raise InputError(
                f"holds {len(structures)} structures: {listed}. Choose one with --structure.",
                code="structure-several",
                numbers={"structures": len(structures)},
            )
        return structures[0]

    # A name counts before a number.
    matches = [structure for structure in structures if structure.name == wanted]
    if not matches:
        for structure in structures:
            if str(structure.number) == wanted:
                matches.append(structure)
    if len(matches) == 1:
        return matches[0]
    if matches:
        raise InputError(
            f"holds several structures of that name. Choose one by its number: {listed}.",
            code="structure-several",
            numbers={"structures": len(matches)},
        )
    raise InputError(
        f"holds no structure of that name or number. Choose one of {listed}.",
        code="structure-unknown",
        numbers={"structures": len(structures)},
    )
