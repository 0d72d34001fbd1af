"""Numbers as a person reads them."""

import pytest

from vfplan.display import duration, length, three_digits


@pytest.mark.parametrize("said, value, text", [
    (length, 0.0, "0 nm"), (length, 3e-13, "< 1 nm"), (length, -3e-10, "> -1 nm"),
    (length, 2.5e-9, "2.50 nm"), (length, -4.02e-6, "-4.02 µm"), (length, 1.354e-3, "1.35 mm"),
    (length, 0.96356, "964 mm"), (length, 12.0, "12.0 m"),
    (duration, 1.5e-7, "150 ns"), (duration, 0.7065, "706 ms"), (duration, 70.0, "70.0 s"),
    (duration, 0.0, "0 ns"),
    # Without an exponent.
    (three_digits, 0.01251, "0.0125"), (three_digits, 1250.0, "1250"),
    (three_digits, 99.99, "100.0"), (three_digits, 0, "0"), (three_digits, -0.0, "0"),
])  # fmt: skip
def test_a_number_has_three_digits_and_its_unit(said, value, text):
    assert said(value) == text
