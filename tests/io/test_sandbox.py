"""What a reader in a process apart refuses arrives here as it was raised there."""

import pytest

from vfplan.errors import SessionError
from vfplan.io.sandbox import run_in_sandbox


def test_a_refusal_keeps_its_kind_place_code_and_numbers(tmp_path):
    path = tmp_path / "session.csv"
    path.write_bytes(b"t,x,y,z\n")
    with path.open("rb") as file:
        answers = run_in_sandbox("refusing_job:refuse", file=file, where="another name")
        assert next(answers) == 1
        with pytest.raises(SessionError) as refusal:
            next(answers)
    error = refusal.value
    assert type(error) is SessionError
    assert (error.where, error.code) == ("session.csv", "clock-goes-back")
    assert error.message == "the clock goes back"
    assert error.numbers == {"line": 7, "back_s": 0.25, "at_m": [1.0, None]}
