"""Labelled positions, as one marker file holds them."""

from __future__ import annotations

import csv
import io
import math
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Literal
from unicodedata import category

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import MarkerError
from vfplan.io.numbers import real
from vfplan.io.reading import read_whole

MAX_BYTES = 16 * 2**20
FURTHEST = 1e9  # pixels or metres; nothing real is, and squares of more overflow in the end

MarkerFrame = Literal["image", "patient_lps", "robot_base"]


@dataclass(frozen=True, eq=False)
class MarkerPoints:
    """Labelled positions in one frame."""

    frame: MarkerFrame  # "image" [px], "patient_lps" [m] or "robot_base" [m]
    labels: tuple[str, ...]  # (N,) labels, each once
    positions: NDArray[np.float64]  # (N, 2) in "image", (N, 3) elsewhere
    # (N,) or (N, 3) standard deviations [m] an axis; `None` where the file names none
    sigma: NDArray[np.float64] | None = None
    where: str | None = None  # the file, for messages

    def __post_init__(self) -> None:
        if not self.labels:
            raise MarkerError("holds no marker; at least three are wanted", where=self.where)
        for label, count in Counter(self.labels).items():
            if count > 1:
                raise MarkerError(
                    f"label {label!r} occurs {count} times; each marker may occur once",
                    where=self.where,
                )


def read_text(path: str | Path) -> str:
    """A marker file's text, or a `MarkerError`."""
    try:
        return read_whole(Path(path), MAX_BYTES, MarkerError).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise MarkerError("is not UTF-8 text", where=str(path)) from None


def table_rows(text: str, where: str) -> list[list[str]]:
    """The rows of a CSV that hold anything, whichever of LF, CRLF and CR ends its lines.

    Raises `MarkerError` where the text is no CSV.
    """
    try:
        rows = list(csv.reader(io.StringIO(text, newline=None), strict=True))
    except csv.Error as error:
        raise MarkerError(f"is no CSV: {error}", where=where) from None
    return [row for row in rows if any(cell.strip() for cell in row)]


def number(text: object, what: str, where: str) -> float:
    """A finite number, or a `MarkerError` that says what was found instead."""
    try:
        if isinstance(text, bool):  # which Python takes for 0 or 1
            raise ValueError
        value = real(text) if isinstance(text, str) else float(text)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        shown, plain = f"{text!r}"[:60], str(text).strip().lower().lstrip("+-")
        wanted = "a finite number" if plain in ("nan", "inf", "infinity") else "a number"
        raise MarkerError(f"{what} is {shown}; {wanted} is wanted", where=where) from None
    if not math.isfinite(value):
        raise MarkerError(f"{what} is {text!r}; a finite number is wanted", where=where)
    if abs(value) > FURTHEST:
        raise MarkerError(f"{what} is {text!r}; at most {FURTHEST:g} is allowed", where=where)
    return value


def label_of(text: object, what: str, where: str) -> str:
    """A label without surrounding blanks, or a `MarkerError` where no bundle can hold it."""
    label = str(text).strip() if text is not None else ""
    if not label:
        raise MarkerError(f"{what} has no label; every marker needs one", where=where)
    if any(category(sign) == "Cc" for sign in label):
        raise MarkerError(f"{what} has the label {label!r}: a control character", where=where)
    return label
