"""Slices of the kinds that users make: never silently wrong, seldom refused or warned for nothing.

`python docs/make_slices_table.py` prints the whole table; this is a cut of it, with its bounds.
"""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from boxes import HIDDEN
from slices import KINDS, TRAPS, draw
from verdicts import judge

FALSE = 0.05  # of the slices with one right answer: refused, or warned of, for nothing


def verdicts(kinds, seeds):
    return {(kind, seed): judge(draw(kind, seed)) for kind in kinds for seed in seeds}


TOLD = 0.85  # of letters at an end and dots beside
COVERS = [kind for kind in HIDDEN if kind.endswith("over the end")]


def silent(found):
    return {key: v.why for key, v in found.items() if v.outcome == "silent"}


def test_one_right_answer_is_given_without_ado():
    found = verdicts(KINDS, (1, 3))
    count = Counter(v.outcome for v in found.values())
    assert not silent(found)
    assert count["falsely refused"] + count["falsely warned"] <= FALSE * len(found), {
        key: v.why for key, v in found.items() if v.outcome.startswith("falsely")
    }
    z = np.concatenate([v.z for v in found.values() if v.z is not None])
    assert 0.7 < np.sqrt(np.mean(z**2)) < 1.6


def test_what_could_be_wrong_is_refused_or_told():
    found = verdicts(TRAPS, (2, 5))
    assert not silent(found)
    assert all(v.why for v in found.values() if v.outcome != "right")


def hidden(kinds, seeds):
    return {(kind, seed): judge(draw(kind, seed, HIDDEN)) for kind in kinds for seed in seeds}


def test_no_cover_without_colour_over_an_end_is_silent():
    assert not silent(hidden(COVERS, (4, 5)))


def test_letters_and_dots_are_mostly_told():
    kinds = HIDDEN.keys() - COVERS
    assert len(silent(hidden(kinds, (4, 5)))) <= (1 - TOLD) * 2 * len(kinds)


@pytest.mark.full
def test_the_whole_table():
    found = verdicts({**KINDS, **TRAPS}, range(20))
    count = Counter(v.outcome for v in found.values())
    clear = len(KINDS) * 20
    assert not silent(found)
    assert count["falsely refused"] <= 0.04 * clear
    assert count["falsely warned"] <= 0.03 * clear
    assert len(silent(hidden(COVERS, range(20)))) <= 0.01 * 20 * len(COVERS)
    kinds = HIDDEN.keys() - COVERS
    assert len(silent(hidden(kinds, range(20)))) <= (1 - TOLD) * 20 * len(kinds)
