"""What a reader in a process apart refuses arrives here as it was raised there, and so a crash."""

import os
from pathlib import Path

import numpy as np
import pytest
from refusals import refuses

import vfplan.io.sandbox
from vfplan.errors import SessionError
from vfplan.io.sandbox import run_in_sandbox


@pytest.fixture
def job_of(monkeypatch):
    """`python -I` finds no tests: the helper is one that knows this folder."""
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    monkeypatch.setattr(vfplan.io.sandbox, "_helper", None)
    monkeypatch.setattr(vfplan.io.sandbox, "STEP_S", 1)
    return lambda function: f"{Path(__file__).stem}:{function.__name__}"


def refuse(_stream):
    yield 1
    raise SessionError(
        "the clock goes back",
        where="session.csv",
        code="clock-goes-back",
        numbers={"line": np.int64(7), "back_s": np.float64(0.25), "at_m": np.array([1.0, np.nan])},
    )


def test_a_refusal_keeps_its_kind_place_code_and_numbers(job_of, tmp_path):
    path = tmp_path / "session.csv"
    path.write_bytes(b"t,x,y,z\n")
    with path.open("rb") as file:
        answers = run_in_sandbox(job_of(refuse), file=file, where="another name")
        assert next(answers) == 1
        with refuses(SessionError, "clock-goes-back") as refusal:
            next(answers)
    error = refusal.value
    assert (error.where, error.message) == ("session.csv", "the clock goes back")
    assert error.numbers == {"line": 7, "back_s": 0.25, "at_m": [1.0, None]}


def crash(*_):
    os.abort()
    yield


def hang(*_):
    while True:
        pass
    yield


def swell(*_):
    yield bytes(bytearray(2 << 30))


@pytest.mark.slow
@pytest.mark.parametrize("fault", [crash, hang, swell])
def test_a_reader_that_fails_is_an_error_like_any_other(fault, job_of):
    with refuses(SessionError, "reader-stopped"):
        list(run_in_sandbox(job_of(fault), where="a", kind=SessionError))
