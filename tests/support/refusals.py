"""Errors by their code: sentences may be bettered without touching a test."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from vfplan.errors import VfplanError


@contextmanager
def refuses(kind: type[VfplanError], code: str, **numbers: Any) -> Iterator[Any]:
    """The block raises an error of that class and code, with these numbers among its own."""
    with pytest.raises(kind) as caught:
        yield caught
    assert caught.value.code == code, caught.value
    assert numbers.items() <= caught.value.numbers.items(), caught.value.numbers
