"""What is left of a bag whose recorder was killed: its messages up to the break, written as a whole temporary bag.

And what is looked at in a bag of SQLite before rosbags opens it: that its tables are plain ones. A view or a generated
column is a program, which may run without end.
"""

import os
import shutil
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from io import BytesIO
from pathlib import Path
from typing import BinaryIO
from urllib.parse import quote

from rosbags.interfaces import Connection
from rosbags.rosbag1 import ReaderError
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag1.reader import Header
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from curvescan.errors import LogFormatError
from curvescan.io.files.lines import printable
from curvescan.io.ros.bags.bag_files import BagKind, Unpacker
from curvescan.io.ros.bags.hardening.limits import check_qos

_PIECE_BYTES = 1 << 20
_MAX_CHUNK_BYTES = 1 << 30
_MAX_CONNECTIONS = 4096
_BAG_HEADER, _CHUNK, _CONNECTION, _MESSAGE = 3, 5, 7, 2
_ROS1_VERSION = b"#ROSBAG V2.0\n"
_MCAP_MAGIC = b"\x89MCAP0\r\n"
_MCAP_END = b"\x02" + (20).to_bytes(8, "little") + bytes(20) + _MCAP_MAGIC
_MCAP_CHUNK, _MCAP_CHUNK_HEAD = b"\x06", 41  # up to the name of the compression
_MCAP_DATA_END, _MCAP_FOOTER = 0x0F, 0x02
_SQLITE_ENDINGS = ("-wal", "-journal")
_LARGEST_PAGE = 1 << 16  # stands as 1 in the two bytes of the header


def salvage(file: Path, kind: BagKind, target: Path) -> None:
    """Write what can be read of a broken bag as a whole one; it may hold no message. Raises OSError."""
    _WRITERS[kind](file, target)


def recorded_bytes(file: Path, kind: BagKind) -> int:
    """Return how long a bag was when it was recorded, by what stands at its beginning; 0 where that is not known."""
    with suppress(OSError, ReaderError), file.open("rb") as source:
        if kind is BagKind.ROS1:
            source.readline()
            return Header.read(source).get_uint64("index_pos")
        if kind is BagKind.SQLITE:
            head = source.read(32)
            size = int.from_bytes(head[16:18], "big")
            return (_LARGEST_PAGE if size == 1 else size) * int.from_bytes(head[28:32], "big")
    return 0


def with_its_journal(file: Path, folder: Path) -> Path:
    """Return a copy of a SQLite database that includes its -wal or -journal file. Raises OSError, sqlite3.Error."""
    copy = folder / "bag.db3"
    shutil.copyfile(file, copy)
    for ending in _SQLITE_ENDINGS:
        beside = file.with_name(file.name + ending)
        if beside.is_file():
            shutil.copyfile(beside, copy.with_name(copy.name + ending))
    with closing(sqlite3.connect(copy)) as database:
        # the library takes a journal in when it first reads; without a -wal the database is one that never had any
        database.execute("select count(*) from sqlite_master").fetchone()
        database.execute("pragma journal_mode=delete").fetchone()
    return copy


def _salvage_mcap(file: Path, target: Path) -> None:
    """Copy the records that are whole, and end the file after them; readers then go through them one by one."""
    n_bytes = file.stat().st_size
    with file.open("rb") as source, target.open("xb") as goal:
        end = _end_of_records(source, len(_MCAP_MAGIC), n_bytes)
        source.seek(end)
        head = source.read(_MCAP_CHUNK_HEAD)
        n_name = int.from_bytes(head[37:41], "little")
        source.seek(0)
        _copy(source, goal, end)
        if head[:1] == _MCAP_CHUNK and n_name == 0:
            # what is whole in a chunk that is cut short, and not compressed, can stand outside of it
            start = end + _MCAP_CHUNK_HEAD + 8
            inner_end = _end_of_records(source, start, n_bytes)
            source.seek(start)
            _copy(source, goal, inner_end - start)
        goal.write(_MCAP_END)


def _end_of_records(source: BinaryIO, position: int, n_bytes: int) -> int:
    """Return where the last whole record ends; the first record begins at `position`."""
    while True:
        source.seek(position)
        head = source.read(9)
        after = position + 9 + int.from_bytes(head[1:], "little")
        if len(head) < 9 or after > n_bytes or head[0] in (_MCAP_DATA_END, _MCAP_FOOTER):
            return position
        position = after


def _copy(source: BinaryIO, goal: BinaryIO, n_bytes: int) -> None:
    while n_bytes > 0 and (piece := source.read(min(n_bytes, _PIECE_BYTES))):
        goal.write(piece)
        n_bytes -= len(piece)


def _salvage_ros1(file: Path, target: Path) -> None:
    connections: dict[int, Connection] = {}
    with file.open("rb") as source, Ros1Writer(target) as writer:
        if source.readline() != _ROS1_VERSION:
            raise ValueError(f"no bag that begins with {_ROS1_VERSION!r}")
        for kind, header, data in _records(source, file.stat().st_size):
            try:
                number = header.get_uint32("conn")
                if kind == _CONNECTION and number not in connections:
                    if len(connections) >= _MAX_CONNECTIONS:
                        return
                    connections[number] = _add_connection(writer, header, data)
                elif kind == _MESSAGE and number in connections:
                    writer.write(connections[number], header.get_time("time"), data)
            except (ReaderError, UnicodeDecodeError):
                return


def _add_connection(writer: Ros1Writer, header: Header, data: bytes) -> Connection:
    about = _fields(data)
    return writer.add_connection(
        header.get_string("topic"),
        about.get_string("type").replace("/", "/msg/"),
        msgdef=about.get_string("message_definition"),
        md5sum=about.get_string("md5sum"),
    )


def _records(source: BinaryIO, n_bytes: int) -> Iterator[tuple[int, Header, bytes]]:
    """Yield the connections and messages of a ROS 1 bag, those in chunks too, up to where it breaks off."""
    unpacker = Unpacker()
    with suppress(Exception):  # rosbags raises its own errors and many others on what is no record
        while source.tell() < n_bytes:
            header = Header.read(source)
            size = int.from_bytes(source.read(4), "little")
            kind = header.get_uint8("op")
            if kind not in (_CHUNK, _CONNECTION, _MESSAGE):
                source.seek(size, os.SEEK_CUR)
                continue
            data = source.read(min(size, _MAX_CHUNK_BYTES))
            if kind != _CHUNK:
                if len(data) == size:
                    yield kind, header, data
                continue
            packing = header.get_string("compression")
            if packing != "none":
                data = unpacker.unpack(data, packing)
            yield from _records(BytesIO(data), len(data))


def _fields(data: bytes) -> Header:
    return Header.read(BytesIO(len(data).to_bytes(4, "little") + data))


def _salvage_sqlite(file: Path, target: Path) -> None:
    """Copy the tables row by row, in the order of their numbers, until the database breaks off."""
    with (
        _whole_pages(file, target.with_name(f"{target.name}-pages")) as sound,
        closing(sqlite3.connect(f"{sound.absolute().as_uri()}?immutable=1&mode=ro", uri=True)) as source,
        closing(sqlite3.connect(target)) as goal,
    ):
        # else a file that is shorter than it says is not looked at
        source.execute("pragma writable_schema=on")
        source.text_factory = bytes
        names = [b"schema", b"metadata", b"message_definitions", b"topics", b"messages"]
        for name in names:
            query = "select sql from sqlite_master where type='table' and cast(name as blob)=?"
            found = source.execute(query, (name,)).fetchone()
            if found is None or found[0].lower().split()[:2] != [b"create", b"table"]:
                continue
            goal.execute(found[0].decode())
            rows = source.execute(f"select * from {name.decode()} not indexed")
            marks = ",".join("?" * len(rows.description))
            with suppress(sqlite3.DatabaseError):
                for row in rows:
                    # text was read as bytes
                    values = [_text(v) if isinstance(v, bytes) and name != b"messages" else v for v in row]
                    goal.execute(f"insert into {name.decode()} values ({marks})", values)
        goal.commit()


@contextmanager
def _whole_pages(file: Path, copy: Path) -> Iterator[Path]:
    """Yield a database without the last of its pages if that is cut: SQLite reads what is missing of one as zeros."""
    with file.open("rb") as source:
        size = int.from_bytes(source.read(18)[16:], "big")
    n_bytes = file.stat().st_size
    n_over = n_bytes % (_LARGEST_PAGE if size == 1 else max(size, 1))
    if not n_over:
        yield file
        return
    try:
        shutil.copyfile(file, copy)
        os.truncate(copy, n_bytes - n_over)
        yield copy
    finally:
        copy.unlink(missing_ok=True)


_WRITERS: dict[BagKind, Callable[[Path, Path], None]] = {
    BagKind.ROS1: _salvage_ros1,
    BagKind.MCAP: _salvage_mcap,
    BagKind.SQLITE: _salvage_sqlite,
}


_NEEDED = ("messages", "topics")
_READ = (*_NEEDED, "schema", "message_definitions")
_MAX_TOPICS = 4096
_MAX_NAMES = 1000
_GENERATED = (2, 3)


def sqlite_reader(file: Path) -> Sqlite3Reader:
    """Return rosbags' reader of a database, having looked at its schema. Raises LogFormatError."""
    # the reader puts the path into a URI, where ?, # and % would have a meaning
    name = quote(file.absolute().as_posix(), safe="/:")
    try:
        with closing(sqlite3.connect(f"file:{name}?immutable=1&mode=ro", uri=True)) as database:
            database.text_factory = bytes  # which need not be UTF-8
            _check(database)
    except sqlite3.Error as error:
        raise LogFormatError(f"its database cannot be read: {printable(str(error), 200)}") from error
    return Sqlite3Reader(Path(name))


def unfinished(file: Path) -> bool:
    """Return whether a database was not closed: what its log beside it holds is not part of it, and not read."""
    beside = (file.with_name(file.name + ending) for ending in _SQLITE_ENDINGS)
    return any(one.is_file() and one.stat().st_size > 0 for one in beside)


def _check(database: sqlite3.Connection) -> None:
    query = f"select lower(name), type, sql from sqlite_master limit {_MAX_NAMES}"
    found = {_text(name): (_text(kind), _text(sql)) for name, kind, sql in database.execute(query)}
    if any(found.get(name, ("", ""))[0] not in ("table", "view") for name in _NEEDED):
        names = ", ".join(name for name, (kind, _) in found.items() if kind == "table")
        raise LogFormatError(
            "it is a SQLite database without the tables messages and topics of a bag: it holds "
            f"{printable(names, 200) or 'no table'}"
        )
    for name in _READ:
        kind, sql = found.get(name, ("table", ""))
        is_virtual = sql.lower().split()[1:2] == ["virtual"]
        columns = database.execute(f"pragma table_xinfo({name})").fetchall()
        is_generated = any(column[6] in _GENERATED for column in columns)
        if kind != "table" or is_virtual or is_generated:
            raise LogFormatError(f"its {name} are no plain table, as a recorder makes one")
    (n_topics,) = database.execute("select count(*) from topics").fetchone()
    if n_topics > _MAX_TOPICS:
        raise LogFormatError(f"it has {n_topics:,} topics, and a bag at most {_MAX_TOPICS:,}")
    columns = database.execute("pragma table_info(topics)").fetchall()
    if any(_text(column[1]) == "offered_qos_profiles" for column in columns):
        query = "select offered_qos_profiles from topics"
        for (text,) in database.execute(query):
            check_qos(text if isinstance(text, bytes) else b"")


def _text(value: object) -> str:
    return value.decode(errors="replace") if isinstance(value, bytes) else str(value)
