"""What the files of a ROS bag hold: their channels, and messages in the order of the log.

ROS 1 bags and SQLite are read by rosbags, MCAP by mcap. Each channel has types of its own, for two
may define one name differently, and no other suffers from one that cannot be decoded.
"""

from __future__ import annotations

import functools
import heapq
import importlib
import itertools
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path
from types import ModuleType
from typing import Any, BinaryIO

from vfplan.errors import MissingExtra, SessionError, SettingError, requires_extra
from vfplan.io.files import opened_file

BAG_SUFFIXES = (".bag", ".mcap", ".db3")
# How a message of ROS 2 begins whose numbers are little-endian.
CDR_LITTLE_ENDIAN = b"\x00\x01\x00\x00"
# How a complete MCAP file ends.
MCAP_END = b"\x89MCAP0\r\n"
# Number of messages of a recording of ours in which each of its channels speaks.
FIRST_MESSAGES = 1000
# What stands between the files of a definition in IDL.
IDL_RULE = "=" * 80 + "\n"


@dataclass(frozen=True, eq=False)
class Channel:
    """A sender of messages of one type."""

    topic: str
    type: str
    # Of the topic's channels in one file, from 1
    number: int
    # "cdr" or "ros1"
    encoding: str
    # The definition of its type, empty where there is none, whether it is in IDL, and its digest
    definition: str
    is_idl: bool
    digest: str

    def decode(self, raw: bytes) -> Any:
        """A message; raises `SessionError` where the bag does not say what its bytes mean."""
        try:
            if self.encoding == "ros1":
                return self._types.deserialize_ros1(raw, self.type)
            return self._types.deserialize_cdr(raw, self.type)
        except Exception as error:  # What rosbags raises for what it does not know is of all sorts.
            why = str(error).rstrip(".") or type(error).__name__
            message = f"topic {self.topic!r}, {self.type}, cannot be decoded: {why}. Choose another"
            raise SessionError(message, code="type-undefined") from None

    @functools.cached_property
    def _types(self) -> Any:
        typesys = importlib.import_module("rosbags.typesys")
        if self.encoding not in ("cdr", "ros1"):
            raise ValueError(f"its encoding is {self.encoding!r}")
        store = typesys.get_typestore(typesys.Stores.EMPTY)
        if not self.definition:
            store = typesys.get_typestore(typesys.Stores.LATEST)
        elif self.is_idl:
            types = {}
            parts = self.definition.split(IDL_RULE)[1:]
            for text in [part.partition("\n")[2] for part in parts] or [self.definition]:
                types |= typesys.get_types_from_idl(text)
            store.register(types)
        else:
            store.register(typesys.get_types_from_msg(self.definition, self.type))
        digest = self.digest
        if digest and self.encoding == "ros1":
            digest = store.generate_msgdef(self.type)[1]
        elif digest:
            digest = store.hash_rihs01(self.type)
        if digest != self.digest:
            raise ValueError("its definition is of another version")
        return store


# Of each message the channel, when it was recorded [ns], and its bytes.
Messages = Iterator[tuple[Channel, int, bytes]]


@dataclass(frozen=True)
class Part:
    """An open bag, or one of its files, or a folder with its own list of files."""

    channels: list[Channel]
    # The messages of a topic
    messages: Callable[[str], Messages]
    # It ends before its end.
    is_cut: bool = False


def is_bag(path: Path) -> bool:
    """Whether a path looks like a ROS 1 or ROS 2 bag."""
    return path.suffix in BAG_SUFFIXES or bool(bag_parts(path))


def bag_parts(path: Path) -> list[Path]:
    """What is read of a bag: a file, a folder's MCAP files, or what its metadata.yaml lists."""
    if not path.is_dir():
        return [path] if path.suffix in BAG_SUFFIXES else []
    files = sorted(path.glob("*.mcap"))
    if not files and (path / "metadata.yaml").is_file():
        return [path]
    return files or sorted(path.glob("*.db3"))


@contextmanager
def opened_bag(path: Path) -> Iterator[Part]:
    """A bag, open, its messages merged by the log's time.

    Raises SessionError: what the libraries raise
    Raises MissingExtra: the library that its files need is not installed
    """
    try:
        with ExitStack() as stack:
            parts = [open_part(part, stack) for part in bag_parts(path)]
            channels = list(itertools.chain(*(part.channels for part in parts)))

            def messages(topic: str) -> Messages:
                return heapq.merge(*(part.messages(topic) for part in parts), key=itemgetter(1))

            yield Part(channels, messages, any(part.is_cut for part in parts))
    except (SessionError, SettingError, MissingExtra, GeneratorExit):
        raise
    except Exception as error:  # Each module of rosbags has its own class, and others come through.
        reason = (str(error) or type(error).__name__).rstrip(".")
        message = f"cannot be read as a ROS bag: {reason}. Record or copy it again"
        raise SessionError(message, code="bag-broken") from None


# How the messages of a bag that is no MCAP file are packed, and what reads it, by its suffix;
# a folder is one of ROS 2.
ENCODINGS = {".bag": ("ros1", "rosbags.rosbag1")}


def open_part(path: Path, stack: ExitStack) -> Part:
    """A part of a bag that stays open until the stack is left."""
    library("rosbags")
    if path.suffix == ".mcap":
        return mcap_part(stack.enter_context(opened_file(path, SessionError)))
    encoding, package = ENCODINGS.get(path.suffix, ("cdr", "rosbags.rosbag2"))
    reader = stack.enter_context(library(package).Reader(path))
    channels, counts = {}, Counter()
    for sender in reader.connections:
        counts[sender.topic] += 1
        channels[sender.id] = Channel(
            sender.topic, sender.msgtype, counts[sender.topic], encoding, sender.msgdef.data,
            sender.msgdef.format.name == "IDL", sender.digest or "",
        )  # fmt: skip

    def messages(topic: str) -> Messages:
        senders = [sender for sender in reader.connections if sender.topic == topic]
        for sender, recorded, raw in reader.messages(connections=senders) if senders else ():
            yield channels[sender.id], recorded, raw

    return Part([*channels.values()], messages)


def mcap_part(stream: BinaryIO, in_file_order: bool = False) -> Part:
    """An MCAP file of ROS 1 or ROS 2; of one that was cut off its whole part.

    In the order of the file, one that was cut off or has no index has the channels of its first
    messages alone, which are known without a look at the rest.
    """
    module = library("mcap.reader")
    stream.seek(-len(MCAP_END), 2)
    is_cut = stream.read() != MCAP_END
    stream.seek(0)
    summary = None if is_cut else module.make_reader(stream).get_summary()
    has_index = summary is not None and bool(summary.channels)

    def read(topics: list[str] | None) -> Iterator[tuple[Any, Any, Any]]:
        stream.seek(0)
        make = module.make_reader if has_index else module.NonSeekingReader
        try:
            reader = make(stream, validate_crcs=not is_cut)
            yield from reader.iter_messages(topics, log_time_order=not (is_cut or in_file_order))
        except Exception:  # The package passes on the errors of struct, lz4 and zstd.
            if not is_cut:
                raise

    if has_index:
        found = {c.id: (c, summary.schemas.get(c.schema_id)) for c in summary.channels.values()}
    else:
        messages_read = itertools.islice(read(None), FIRST_MESSAGES if in_file_order else None)
        found = {channel.id: (channel, schema) for schema, channel, _ in messages_read}
    channels, counts = {}, Counter()
    for key, (channel, schema) in found.items():
        counts[channel.topic] += 1
        name, text, is_idl = "", "", False
        if schema is not None:
            # A type of ROS 1 has its package and its name alone.
            name = schema.name.replace("/", "/msg/") if schema.name.count("/") == 1 else schema.name
            is_idl = schema.encoding in ("ros2idl", "omgidl")
            if is_idl or schema.encoding in ("ros1msg", "ros2msg"):
                text = schema.data.decode("utf-8", "replace")
        channels[key] = Channel(
            channel.topic, name, counts[channel.topic], channel.message_encoding, text, is_idl, ""
        )

    def messages(topic: str) -> Messages:
        for _, channel, message in read([topic]):
            yield channels[channel.id], message.log_time, message.data

    return Part([*channels.values()], messages, is_cut)


def library(name: str) -> ModuleType | Any:
    """A module of rosbags, mcap or foxglove; raises `MissingExtra` without it."""
    extra, what = {
        "rosbags": ("ros", "ROS bags need the package rosbags"),
        "mcap": ("live", "MCAP needs the package mcap"),
        "foxglove": ("live", "scenes for viewers need the package foxglove-sdk"),
    }[name.partition(".")[0]]
    with requires_extra(what, extra):
        return importlib.import_module(name)
