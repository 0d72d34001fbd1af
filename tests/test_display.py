"""Numbers as a person reads them."""

import pytest

from vfplan.display import duration, length, three_digits


@pytest.mark.parametrize(
    ("metres", "text"),
    [
        (0.0, "0 nm"), (3e-13, "< 1 nm"), (-3e-10, "> -1 nm"), (2.5e-9, "2.50 nm"),
        (-4.02e-6, "-4.02 µm"), (1.354e-3, "1.35 mm"), (0.96356, "964 mm"), (12.0, "12.0 m"),
    ],
)  # fmt: skip
def test_lengths(metres, text):
    assert length(metres) == text


@pytest.mark.parametrize(
    ("seconds", "text"), [(1.5e-7, "150 ns"), (0.7065, "706 ms"), (70.0, "70.0 s"), (0.0, "0 ns")]
)
def test_durations(seconds, text):
    assert duration(seconds) == text


@pytest.mark.parametrize(
    ("value", "text"), [(0.01251, "0.0125"), (1250.0, "1250"), (99.99, "100.0"), (0, "0")]
)
def test_three_digits_without_an_exponent(value, text):
    assert three_digits(value) == text
