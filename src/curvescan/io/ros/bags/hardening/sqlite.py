"""What is looked at in a ROS 2 bag of SQLite before rosbags opens it: that its tables are plain ones.

A view or a generated column is a program, which may run without end or make values that stand nowhere in the file.
"""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path
from urllib.parse import quote

from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from curvescan.errors import LogFormatError
from curvescan.io.files.printable import printable
from curvescan.io.ros.bags.hardening.limits import check_qos

_NEEDED = ("messages", "topics")
_READ = (*_NEEDED, "schema", "message_definitions")
_MAX_TOPICS = 4096
_MAX_NAMES = 1000
_GENERATED = (2, 3)
_REMAINS = ("-wal", "-journal")


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
    beside = (file.with_name(file.name + ending) for ending in _REMAINS)
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
