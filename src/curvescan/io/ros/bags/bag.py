"""Bag: the topics and the messages of a ROS bag, read by the library rosbags, whose errors become ours.

On damaged files its parsers raise their own errors and nearly every builtin one.
"""

import errno
import sqlite3
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeAlias

from rosbags.interfaces import Connection
from rosbags.rosbag1 import ReaderError as Ros1Error
from rosbags.rosbag1 import WriterError as RosbagsWriterError
from rosbags.rosbag2 import ReaderError as Ros2Error
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from curvescan.errors import CurvescanError, LogFileError, LogFormatError
from curvescan.io.files.lines import (
    MAX_UNPACKED_RATIO,
    MIN_UNPACKED_LIMIT,
    BrokenRecordError,
    is_packed,
    printable,
    temporary_folder,
    unpack,
)
from curvescan.io.ros.bags.bag_files import BagKind, bag_kind, recorded_counts, storage_files
from curvescan.io.ros.bags.hardening.limits import CheckedMcapReader, CheckedRos1Reader
from curvescan.io.ros.bags.hardening.salvage import recorded_bytes, salvage, sqlite_reader, unfinished, with_its_journal
from curvescan.io.ros.messages import Decoder


@dataclass(frozen=True)
class Topic:
    """What a bag says of a topic."""

    msgtype: str  # type of its messages, ``"sensor_msgs/msg/LaserScan"`` for ROS 1 as for ROS 2
    count: int  # messages, by the bag's own count


@dataclass(frozen=True, slots=True)
class Message:
    """One message as it stands in the bag."""

    # topic, msgtype: where it belongs
    topic: str
    msgtype: str
    received: int  # when the recorder received it, nanoseconds
    data: bytes  # not yet decoded; see Bag.decode


class Bag:
    """A ROS bag that can be read again and again; no file stays open between the readings."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.is_whole = True
        stored = storage_files(path) if path.is_dir() else (path,)
        kind = bag_kind(stored[0])
        if kind is None:
            raise LogFormatError(f"{path} is no ROS bag: only bags hold several lasers and their mounts")
        self.kind = kind
        self._files = [self._unpacked(file) for file in stored]
        self._n_given = {}
        for file, given in zip(self._files, stored, strict=True):
            self._n_given[file] = given.stat().st_size
        self._journal_notes: list[str] = []
        if kind is BagKind.SQLITE:
            self._files = [self._with_its_journal(file) if unfinished(file) else file for file in self._files]
        self.is_cut, self._share = False, 1.0
        self._part_notes: list[str] = []
        files, self._files = self._files, []
        connections: list[Connection] = []
        errors: list[LogFormatError] = []
        for file, given in zip(files, stored, strict=True):
            try:
                connections += self._connections_of(file)
            except LogFormatError as error:
                errors.append(error)
                self._part_notes.append(f"no message of {printable(given.name)} can be read: this file is left out")
        if errors and not any(c.msgcount for c in connections):
            raise errors[0]
        self.is_cut |= bool(errors)
        self.topics = _topics(connections)
        self._decoder = Decoder(connections, is_ros1=kind is BagKind.ROS1)

    @property
    def notes(self) -> tuple[str, ...]:
        """What was assumed to read the bag, a sentence each."""
        cut = ("its compressed data break off or are damaged: what could be unpacked of them is read",)
        return (*(() if self.is_whole else cut), *self._part_notes, *self._journal_notes, *self._decoder.notes)

    def messages(self, topics: Collection[str], received: int | None = None) -> Iterator[Message]:
        """Yield the messages of these topics in order of reception, or only those received at a time, nanoseconds."""
        for file in self._files:
            limit = MIN_UNPACKED_LIMIT + MAX_UNPACKED_RATIO * self._n_given[file]
            with self._opened(file) as reader:
                wanted = [
                    c for c in reader.connections if c.topic in topics and c.msgtype == self.topics[c.topic].msgtype
                ]
                stop = None if received is None else received + 1
                stream = iter(reader.messages(wanted, received, stop) if wanted else ())
                while True:
                    with self._own_errors():
                        item = next(stream, None)
                    if item is None:
                        break
                    connection, when, data = item
                    if connection.topic not in topics:  # a damaged table may give two topics one number
                        continue
                    limit -= len(data) if isinstance(data, bytes) else 0
                    if limit < 0:  # an index may lead to the same bytes again and again
                        raise self._unreadable("its messages are longer than a file of its size can hold")
                    # a column of SQLite holds values of any type, whatever its declaration
                    yield Message(
                        connection.topic,
                        connection.msgtype,
                        when if isinstance(when, int) else 0,
                        data if isinstance(data, bytes) else b"",
                    )

    def n_recorded(self, topic: str) -> int:
        """Return about how many messages a topic had when the bag was recorded, those included that are cut off."""
        counts = recorded_counts(self.path) if self.path.is_dir() else {}
        return max(counts.get(topic, 0), round(self.topics[topic].count / self._share))

    def decode(self, message: Message) -> Any:
        """Return a message with its fields as attributes. Raises BrokenRecordError."""
        return self._decoder.decode(message.data, message.msgtype)

    def each(self, topics: Collection[str], use: Callable[[Message, Any], object], n_most: int | None = None) -> int:
        """Hand decoded messages to a function, up to where the bag is damaged; return how many could not be read."""
        n_broken = 0
        with suppress(LogFormatError):
            for message in islice(self.messages(topics), n_most):
                try:
                    use(message, self.decode(message))
                except (BrokenRecordError, AttributeError, TypeError, ValueError, OverflowError):
                    n_broken += 1
        return n_broken

    def _unpacked(self, file: Path) -> Path:
        if not is_packed(file):
            return file
        folder = temporary_folder(self)
        self.is_whole &= unpack(file, folder / "bag")
        return folder / "bag"

    def _connections_of(self, file: Path) -> list[Connection]:
        """Return the connections of a file, which is read from now on; of one that is cut short, what is left of it."""
        try:
            with self._opened(file) as reader:
                connections = list(reader.connections)
        except LogFormatError as error:
            rest = temporary_folder(self) / "rest"
            try:
                salvage(file, self.kind, rest)
                self._n_given[rest] = self._n_given[file]
                with self._opened(rest) as reader:
                    connections = list(reader.connections)
            except (OSError, ValueError, LogFormatError, sqlite3.Error, RosbagsWriterError):
                raise error from None
            if not any(c.msgcount for c in connections):
                raise
            n_bytes, n_recorded = file.stat().st_size, recorded_bytes(file, self.kind)
            self._share = min(self._share, n_bytes / max(n_recorded, n_bytes))
            self.is_cut, file = True, rest
        self._files.append(file)
        return connections

    def _with_its_journal(self, file: Path) -> Path:
        what = "the database was not closed: what stands in its -wal or -journal file"
        try:
            copy = with_its_journal(file, temporary_folder(self))
        except (OSError, sqlite3.Error) as error:
            reason = getattr(error, "strerror", None) or str(error)
            self._journal_notes = [f"{what} is not read ({printable(reason, 100)})"]
            return file
        self._journal_notes = [f"{what} is read as well, from a copy"]
        self._n_given[copy] = max(copy.stat().st_size, self._n_given[file])
        return copy

    @contextmanager
    def _opened(self, file: Path) -> "Iterator[_Reader]":
        if not file.is_file():
            raise LogFileError(f"cannot read {self.path}: it has gone since it was opened")
        with self._own_errors():
            reader = _READERS[self.kind](file, self._n_given[file])
            reader.open()
        try:
            yield reader
        finally:
            with suppress(Exception):
                reader.close()

    @contextmanager
    def _own_errors(self) -> Iterator[None]:
        try:
            yield
        except LogFormatError as error:
            raise self._unreadable(str(error)) from error
        except CurvescanError:
            raise
        except (Ros1Error, Ros2Error) as error:
            raise self._unreadable(printable(" ".join(str(error).split()), 300).rstrip(".")) from error
        except Exception as error:
            # an offset of the file's own that leads out of it is an invalid argument
            if isinstance(error, OSError) and error.errno not in (None, errno.EINVAL):
                raise LogFileError(f"cannot read {self.path}: {error.strerror}") from error
            reason = f"its structure is damaged ({type(error).__name__})"
            raise self._unreadable(reason) from error

    def _unreadable(self, reason: str) -> LogFormatError:
        whole = "" if self.is_whole else "; its compressed data break off or are damaged"
        return LogFormatError(f"{self.path} is a {self.kind.value} that cannot be read: {reason}{whole}")


def _topics(connections: list[Connection]) -> Mapping[str, Topic]:
    """Return the topics by name; a topic has as many connections as publishers and files."""
    topics: dict[str, Topic] = {}
    for c in connections:
        if not (isinstance(c.topic, str) and isinstance(c.msgtype, str)):
            continue  # a column of SQLite holds values of any type
        known = topics.get(c.topic, Topic(c.msgtype, 0))
        if c.msgtype == known.msgtype:
            topics[c.topic] = Topic(c.msgtype, known.count + c.msgcount)
    return MappingProxyType(topics)


_Reader: TypeAlias = CheckedRos1Reader | CheckedMcapReader | Sqlite3Reader

_READERS: dict[BagKind, Callable[[Path, int], _Reader]] = {
    BagKind.ROS1: CheckedRos1Reader,
    BagKind.SQLITE: lambda file, _: sqlite_reader(file),
    BagKind.MCAP: CheckedMcapReader,
}
