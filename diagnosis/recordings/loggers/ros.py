"""MCAP and rosbag2: messages in CDR or JSON, decoded by the definitions that the file itself holds.

Decoders of mcap-ros2-support walk the definitions; those of other libraries make Python of them and execute it, which a
foreign file shall not have. Bags from before ROS 2 Iron hold none: those of the standard messages are then rosbags'.
"""

from __future__ import annotations

import json
import sqlite3
from array import array
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader, make_reader
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory

from diagnosis.recordings.loggers.found import WIDEST, Found, Unreadable

Message = tuple[str, int, Any]
"""Topic, time of logging (ns) and content."""
_LARGEST_RECORD = 1 << 30
_STAMPS = ({"sec", "nanosec"}, {"sec", "nsec"}, {"secs", "nsecs"})
_DEEPEST = 20


def read(path: Path) -> Found:
    """Columns are called ``topic.field.field[2]``, and ``topic.time`` is when a message was logged.

    Times are seconds from the first message of the file, those in messages too, such as ``topic.header.stamp``.

    Args:
        path: an .mcap or .db3 file, or the folder of a rosbag2.

    Raises:
        Unreadable: it cannot be read.
    """
    found = Found()
    topics: dict[str, _Topic] = {}
    first: int | None = None
    left_out: dict[str, str] = {}
    for file in _files(path):
        reader = _mcap if file.suffix == ".mcap" else _sqlite
        for topic, time, content in reader(file, found, left_out):
            first = time if first is None else min(first, time)
            topics.setdefault(topic, _Topic()).add(time, content)
    for topic, why in left_out.items():
        found.notes.append(f"topic '{topic[:60]}' is left out: {why}")
    if first is None:
        raise Unreadable("it holds no messages that are read here: " + ("; ".join(found.notes) or "none at all"))
    for topic, rows in topics.items():
        rows.give(found, topic, first)
    return found


def _files(path: Path) -> list[Path]:
    if not path.is_dir():
        return [path]
    files = sorted(p for ending in ("*.mcap", "*.db3") for p in path.glob(ending) if p.is_file())
    if not files:
        packed = any(path.glob("*.zstd"))
        raise Unreadable(
            "its files are compressed" if packed else "the folder holds no .mcap and no .db3 file",
            "unpack them with 'ros2 bag convert'" if packed else "name the folder that 'ros2 bag record' wrote",
        )
    return files


class _Topic:
    """The numbers of the messages of one topic."""

    def __init__(self) -> None:
        self.times: list[int] = []
        self.values: dict[str, tuple[array[int], array[float]]] = {}
        self.stamps: dict[str, tuple[array[int], list[int]]] = {}
        self.wide: set[str] = set()
        self.labels: tuple[str, ...] = ()

    def add(self, time: int, content: Any) -> None:
        """Take up one message."""
        self.times.append(time)
        self._flat("", content, 0)

    def _flat(self, name: str, value: Any, depth: int) -> None:
        if depth > _DEEPEST:
            return
        if isinstance(value, bool | int | float | np.integer | np.floating):
            rows, numbers = self.values.setdefault(name, (array("q"), array("d")))
            rows.append(len(self.times) - 1)
            numbers.append(float(value))
            return
        members = _members(value)
        if members is not None:
            if set(members) in _STAMPS:
                seconds, rest = (int(number) for number in members.values())
                rows, stamps = self.stamps.setdefault(name, (array("q"), []))
                rows.append(len(self.times) - 1)
                stamps.append(seconds * 10**9 + rest)
                return
            for key, inner in members.items():
                self._flat(f"{name}.{key}" if name else key, inner, depth + 1)
        elif isinstance(value, list | tuple | np.ndarray | array):
            if len(value) > WIDEST:
                self.wide.add(name)
                return
            if name == "name" and all(isinstance(text, str) for text in value):
                self.labels = tuple(value)
            for k, inner in enumerate(value):
                self._flat(f"{name}[{k + 1}]", inner, depth + 1)

    def give(self, found: Found, topic: str, first: int) -> None:
        """Add the columns; NaN where a message lacks a field."""
        clock, count = f"{topic}.time", len(self.times)
        order = np.argsort(np.array(self.times, dtype=np.int64), kind="stable")
        times = np.array([time - first for time in self.times], dtype=np.int64)[order]
        found.add(clock, times / 1e9, clock, "s")
        for name, (rows, numbers) in self.values.items():
            found.add(f"{topic}.{name}" if name else topic, _spread(rows, numbers, count)[order], clock)
        for name, (rows, stamps) in self.stamps.items():
            # Durations are small, and instants are counted from the same first message.
            instants = np.array([s - first if s > 10**17 else s for s in stamps], dtype=np.int64) / 1e9
            found.add(f"{topic}.{name}", _spread(rows, instants, count)[order], clock, "s")
        if self.labels:
            said = ", ".join(f"[{k + 1}] is '{label[:40]}'" for k, label in enumerate(self.labels[:12]))
            found.notes.append(f"'{topic[:60]}': {said}")
        for name in sorted(self.wide):
            found.notes.append(f"'{topic[:60]}.{name[:60]}' has more than {WIDEST} entries, and is left out")


def _spread(rows: Any, values: Any, count: int) -> np.ndarray[Any, Any]:
    made = np.full(count, np.nan)
    made[np.asarray(rows, dtype=np.int64)] = np.asarray(values, dtype=float)
    return made


def _members(value: Any) -> dict[str, Any] | None:
    """The fields of a message; None for what is none."""
    if isinstance(value, dict):
        return {str(key): inner for key, inner in value.items()}
    names = getattr(type(value), "__slots__", None)
    if isinstance(names, list):
        return {name: getattr(value, name) for name in names}
    return None


def _mcap(path: Path, found: Found, left_out: dict[str, str]) -> Iterator[Message]:
    decode = _Decoders(left_out)
    with path.open("rb") as file:
        try:
            messages = list(make_reader(file).iter_messages(log_time_order=False))
        except (McapError, ValueError, KeyError, EOFError, OSError, IndexError, RuntimeError):
            # A recorder that was cut off leaves no summary; what was written before is whole.
            messages = []
            file.seek(0)
            try:
                for message in NonSeekingReader(file, record_size_limit=_LARGEST_RECORD).iter_messages(
                    log_time_order=False
                ):
                    messages.append(message)
            except Exception as error:
                if not messages:
                    raise Unreadable("it is damaged from its beginning", "record it anew, or mend it") from error
            found.notes.append(f"the file ends early; the {len(messages)} messages before are read")
    for schema, channel, logged in messages:
        content = decode(channel.topic, channel.message_encoding, schema, logged.data)
        if content is not None:
            yield channel.topic, logged.log_time, content


def _sqlite(path: Path, found: Found, left_out: dict[str, str]) -> Iterator[Message]:
    decode = _Decoders(left_out)
    with closing(sqlite3.connect(f"{path.as_uri()}?mode=ro&immutable=1", uri=True)) as base:
        base.execute("PRAGMA trusted_schema=OFF")
        tables = {name for (name,) in base.execute("SELECT name FROM sqlite_master WHERE type='table'")}
        if not {"topics", "messages"} <= tables:
            raise Unreadable("it is no rosbag2: it has no topics or no messages", "name the file of 'ros2 bag record'")
        defined: dict[str, tuple[str, bytes]] = {}
        if "message_definitions" in tables:
            asked = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
            defined = {str(kind): (str(form), str(text).encode()) for kind, form, text in base.execute(asked) if text}
        topics: dict[int, tuple[str, str, Schema | None]] = {}
        for number, topic, kind, form in base.execute("SELECT id, name, type, serialization_format FROM topics"):
            known = defined.get(kind) or _standard(str(kind), found)
            schema = Schema(id=int(number), name=str(kind), encoding=known[0], data=known[1]) if known else None
            topics[number] = (str(topic), str(form), schema)
        for number, time, data in base.execute("SELECT topic_id, timestamp, data FROM messages ORDER BY timestamp"):
            topic, form, schema = topics[number]
            content = decode(topic, form, schema, bytes(data))
            if content is not None:
                yield topic, int(time), content


def _standard(kind: str, found: Found) -> tuple[str, bytes] | None:
    """The definition of a standard message as of ROS 2 Humble; None for others."""
    from rosbags.typesys import Stores, get_typestore

    try:
        text, _ = get_typestore(Stores.ROS2_HUMBLE).generate_msgdef(kind, ros_version=2)
    except Exception:
        return None
    note = "the bag holds no message definitions; those of ROS 2 Humble are taken"
    if note not in found.notes:
        found.notes.append(note)
    return "ros2msg", text.encode()


class _Decoders:
    """Decoders by topic; topics without one are noted once."""

    def __init__(self, left_out: dict[str, str]) -> None:
        self.factory = DecoderFactory()
        self.known: dict[str, Callable[[bytes], Any] | None] = {}
        self.left_out = left_out

    def __call__(self, topic: str, encoding: str, schema: Schema | None, data: bytes) -> Any:
        """The content of a message; None if it cannot be decoded."""
        if topic not in self.known:
            self.known[topic] = self._decoder(topic, encoding, schema)
        decoder = self.known[topic]
        if decoder is None:
            return None
        try:
            return decoder(data)
        except Exception:
            self.left_out.setdefault(topic, "some of its messages are damaged")
            return None

    def _decoder(self, topic: str, encoding: str, schema: Schema | None) -> Callable[[bytes], Any] | None:
        if encoding == "json":
            return json.loads
        if encoding != "cdr":
            self.left_out[topic] = f"messages in '{encoding[:20]}' are not read, only in cdr and json"
            return None
        if schema is None:
            self.left_out[topic] = "the bag holds no definition of its messages; convert it with 'ros2 bag convert'"
            return None
        if schema.encoding != "ros2msg":
            self.left_out[topic] = f"its messages are defined in '{schema.encoding[:20]}', which is not read"
            return None
        try:
            return self.factory.decoder_for(encoding, schema)
        except Exception:
            self.left_out[topic] = "the definition of its messages cannot be read"
            return None
