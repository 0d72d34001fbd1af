"""The exception tree: what callers may catch, and which exit code each class has."""

import inspect
import re

import pytest

from vfplan import errors

CODES = {
    "InputError": 3,
    "BundleError": 4,
    "CheckFailed": 1,
    "SettingError": 2,
    "OutputError": 2,
    "MissingExtra": 2,
}


def tree():
    return [
        c for _, c in inspect.getmembers(errors, inspect.isclass) if c.__module__ == errors.__name__
    ]


@pytest.mark.parametrize("error", tree(), ids=lambda c: c.__name__)
def test_every_error_descends_from_vfplan_error_and_stands_in_the_drawing(error):
    assert issubclass(error, errors.VfplanError)
    assert error.__name__ in errors.__doc__


@pytest.mark.parametrize(("name", "code"), CODES.items())
def test_exit_code_holds_for_the_whole_branch(name, code):
    base = getattr(errors, name)
    assert all(c.exit_code == code for c in tree() if issubclass(c, base))


def test_text_names_the_place_first():
    error = errors.MarkerError("three markers lie on a line", where="x1")
    assert str(error) == "x1: three markers lie on a line"
    assert (error.kind, error.where) == ("MarkerError", "x1")


@pytest.mark.parametrize("error", tree(), ids=lambda c: c.__name__)
def test_every_class_has_a_code_of_its_own(error):
    assert re.fullmatch(r"[a-z]+(-[a-z]+)*", error.code)
    assert [c.__name__ for c in tree() if c.code == error.code] == [error.__name__]


def test_a_code_and_numbers_of_the_fault_take_the_place_of_the_class_s():
    plain = errors.CurveError("no line")
    assert (plain.code, plain.numbers) == ("curve", {})
    forked = errors.CurveError("the line forks", code="line-forks", numbers={"branches": 3})
    assert (forked.code, forked.numbers) == ("line-forks", {"branches": 3})
    assert errors.CurveError.code == "curve"
