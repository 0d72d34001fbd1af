"""Bytes that are read from front to back, and never beyond their end."""

from __future__ import annotations

from vfplan.errors import CorruptError


class Window:
    """A window on the payload that is never left."""

    def __init__(self, data: memoryview, where: str) -> None:
        self.data, self.where, self.at = data, where, 0

    def take(self, count: int) -> memoryview:
        """The next bytes; raises `CorruptError` when there are fewer."""
        if count > len(self.data) - self.at:
            raise CorruptError("an object header is cut short", where=self.where)
        self.at += count
        return self.data[self.at - count : self.at]

    def number(self, width: int) -> int:
        """The next bytes as an unsigned little-endian number."""
        return int.from_bytes(self.take(width), "little")

    def wanted(self, width: int, value: int, what: str) -> None:
        """Refuse any number but this one."""
        found = self.number(width)
        if found != value:
            raise CorruptError(f"{what} is {found}; {value} wanted", where=self.where)

    def done(self) -> None:
        """Refuse bytes that are left over."""
        if self.left:
            raise CorruptError("a header message is too long", where=self.where)

    @property
    def left(self) -> int:
        """How many bytes are left."""
        return len(self.data) - self.at


def within(data: memoryview, address: int, size: int, where: str) -> memoryview:
    """A part of the file; raises `CorruptError` when it is not all there."""
    if address > len(data) or size > len(data) - address:
        raise CorruptError("an object header lies outside of the file", where=where)
    return data[address : address + size]
