"""Hostile files: seeds of every reader, mutations of them, and what a reader must hold to on whatever comes out.

A reader is given a file and must return or raise an error of curvescan in one printable sentence that names the file.
The smoke test (test_fuzz.py) and the campaign (``python -m tests.fuzz``) share what stands here.
"""

from __future__ import annotations

import gzip
import io
import pkgutil
import random
import sqlite3
import zipfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer

from curvescan.cli.options import config_tables
from curvescan.diagnostics.inspect import inspect_log
from curvescan.diagnostics.issues import find_issues
from curvescan.errors import CurvescanError
from curvescan.io import Log, read_config, read_csv, read_log, read_poses, read_relations, read_tum, write_config
from curvescan.io.reading import FORMATS
from tests import bags, carmen_files

MAX_SENTENCE = 1000
"""Longest message, characters, without the path."""

Mutation = Callable[[bytes, random.Random], bytes]

_TOKENS = [
    b"nan", b"-inf", b"1e999", b"-1e308", b"1e-320", b"0", b"-0.0", b"-1", b"1", b"2147483647", b"2147483648",
    b"4294967295", b"9223372036854775807", b"18446744073709551616", b"9" * 60, b"0x10", b"1_000", b"", b"#",
    b"\xef\xbb\xbf", b"\xd9\xa3", b"\xff\xfe", b"\x00", b'"', b"True", b"[]", b"1e5000000", b"\r", b"\x1b[2J",
]  # fmt: skip
_SEPARATORS = (b" ", b",", b"\n", b"=", b"\t")
_INTEGERS = (
    *(0, 1, -1, 2, 127, 255, 2**15, 2**16 - 1, 2**28, 2**31 - 1),
    *(2**31, 2**32 - 1, 2**40, 2**62, 2**63 - 1, 2**63),
)


@dataclass(frozen=True, kw_only=True)
class Target:
    """A reader to be tried.

    Attributes
    ----------
    read : callable
        Reads a file to its end, checking what comes back.
    seeds : tuple of bytes
        Sound files.
    mutations : tuple of callable
        Each makes another file of one.
    """

    read: Callable[[Path, random.Random], None]
    seeds: tuple[bytes, ...]
    mutations: tuple[Mutation, ...]

    def hostile(self, rng: random.Random) -> bytes:
        """Return a file made of the seeds by one to four mutations."""
        data = rng.choice(self.seeds)
        for _ in range(rng.choice((1, 1, 1, 2, 2, 3, 4))):
            data = rng.choice(self.mutations)(data, rng)
        draw = rng.random()
        if draw < 0.03:
            data = splice(data, rng.choice(self.seeds), rng)
        if draw > 0.97:
            data = gzip.compress(data, compresslevel=1, mtime=0)
            if draw > 0.985:
                data = flip(data, rng)
        return data


class Finding(Exception):  # noqa: N818
    """A reader broke a promise."""


def check(target: Target, path: Path, data: bytes, rng: random.Random) -> None:
    """Let a reader read a file; raise Finding, or what the reader let through, where it breaks a promise."""
    path.write_bytes(data)
    try:
        target.read(path, rng)
    except CurvescanError as error:
        sentence = str(error).replace(str(path), "PATH")
        if "PATH" not in sentence or not sentence.isprintable() or len(sentence) > MAX_SENTENCE:
            raise Finding(f"no sentence: {sentence[:2000]!r}") from error
        cause: BaseException | None = error
        while cause := cause and (cause.__cause__ or cause.__context__):
            if isinstance(cause, MemoryError):
                raise Finding("memory was asked for that is not there") from error


# ---- what is read


def _read_log(row: str, path: Path, rng: random.Random) -> None:
    draw = rng.random()
    if draw < 0.5:
        log = read_log(path)
    else:  # whatever the sniff says
        reader = next(one.reader for one in FORMATS if one.name == row)
        log = pkgutil.resolve_name(reader)(path, range_max=None, topic=None)
    _check_log(log)
    if draw < 0.1 and len(log) < 200:
        find_issues(inspect_log(log))


def _check_log(log: Log) -> None:
    n_scans = 0
    for scan in log:
        n_scans += 1
        if not np.isfinite(scan.stamp) or scan.valid.shape != scan.ranges.shape:
            raise Finding(f"scan {n_scans} breaks its rules")
    if not n_scans == len(log) > 0:
        raise Finding(f"{n_scans} scans where {len(log)} were promised")
    odometry = log.odometry
    if odometry is not None and len(odometry) != n_scans:
        raise Finding(f"{len(odometry)} poses for {n_scans} scans")
    spoken = [*log.notes, *(f"{read_error.rule} {read_error.first}" for read_error in log.read_errors), *log.tag_counts]
    if not all(len(text) < MAX_SENTENCE and text.isprintable() for text in spoken):
        raise Finding(f"text that spoils the terminal: {spoken!r:.500}")


def _read_config(path: Path, _: random.Random) -> None:
    read_config(path, config_tables())


# ---- mutations of bytes


def flip(data: bytes, rng: random.Random) -> bytes:
    """Change a few bits or bytes, where something is written."""
    content = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 4, 8))):
        at = _place(data, rng)
        if at < len(content):
            content[at] = rng.randrange(256) if rng.random() < 0.5 else content[at] ^ 1 << rng.randrange(8)
    return bytes(content)


def put_integer(data: bytes, rng: random.Random) -> bytes:
    """Overwrite a field of 1, 2, 4 or 8 bytes by a number that is often an edge."""
    size = rng.choice((1, 2, 4, 4, 8, 8))
    order = "little" if rng.random() < 0.8 else "big"
    number = rng.choice(_INTEGERS) if rng.random() < 0.9 else rng.getrandbits(64)
    field = (number % (1 << 8 * size)).to_bytes(size, order)  # type: ignore[arg-type]
    at = _place(data, rng)
    return data[:at] + field + data[at + size :]


def cut(data: bytes, rng: random.Random) -> bytes:
    """Break the file off."""
    return data[: rng.randrange(len(data) + 1)]


def delete(data: bytes, rng: random.Random) -> bytes:
    """Leave a slice out."""
    at = _place(data, rng)
    return data[:at] + data[at + rng.choice((1, 2, 4, 8, 40, 300)) :]


def repeat(data: bytes, rng: random.Random) -> bytes:
    """Write a slice again, a few times, there or elsewhere."""
    at, n = _place(data, rng), rng.choice((1, 4, 16, 100, 1000))
    to = at if rng.random() < 0.5 else _place(data, rng)
    return data[:to] + data[at : at + n] * rng.choice((1, 1, 2, 30)) + data[to:]


def insert(data: bytes, rng: random.Random) -> bytes:
    """Insert random bytes."""
    at = _place(data, rng)
    return data[:at] + rng.randbytes(rng.choice((1, 2, 4, 16))) + data[at:]


def splice(data: bytes, other: bytes, rng: random.Random) -> bytes:
    """Return the head of one file and the tail of another."""
    return data[: rng.randrange(len(data) + 1)] + other[rng.randrange(len(other) + 1) :]


def _place(data: bytes, rng: random.Random) -> int:
    """Return a position, rarely one among the blanks or zeros that fill pages up."""
    n = len(data)
    at = 0
    for _ in range(6):
        at = rng.randrange(n + 1)
        if data[at : at + 8] not in (b" " * 8, bytes(8)):
            break
    return at


BYTES: tuple[Mutation, ...] = (*(flip,) * 6, *(put_integer,) * 6, cut, delete, repeat, insert)

# ---- mutations of text


def put_token(data: bytes, rng: random.Random) -> bytes:
    """Replace a field by a number, or by what looks like one."""
    separator = rng.choice([one for one in _SEPARATORS if one in data] or [b" "])
    fields = data.split(separator)
    for _ in range(rng.choice((1, 1, 3))):
        fields[rng.randrange(len(fields))] = rng.choice(_TOKENS)
    return separator.join(fields)


def move_line(data: bytes, rng: random.Random) -> bytes:
    """Drop a line, write it twice, or move it."""
    lines = data.split(b"\n")
    line = lines.pop(rng.randrange(len(lines)))
    for _ in range(rng.choice((0, 1, 2))):
        lines.insert(rng.randrange(len(lines) + 1), line)
    return b"\n".join(lines)


TEXT: tuple[Mutation, ...] = (put_token,) * 6 + (move_line, move_line, flip, cut, delete, repeat, insert)  # fmt: skip

# ---- mutations that know the format


def change_member(data: bytes, rng: random.Random) -> bytes:
    """Change one array of an .npz, in a zip archive that stays sound; give up on one that is not."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = {info.filename: archive.read(info) for info in archive.infolist()}
        name = rng.choice(list(members))
    except Exception:  # noqa: BLE001
        return flip(data, rng)
    members[name] = rng.choice((flip, put_integer, cut, put_shape, put_shape, repeat))(members[name], rng)
    if rng.random() < 0.1:
        members[rng.choice(("ranges.npy", "stamps.npy", "x.npy", "y.txt"))] = members.pop(name)
    file = io.BytesIO()
    packing = zipfile.ZIP_DEFLATED if rng.random() < 0.3 else zipfile.ZIP_STORED
    with zipfile.ZipFile(file, "w", packing) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return file.getvalue()


def put_shape(data: bytes, rng: random.Random) -> bytes:
    """Change the header of an array."""
    old, new = rng.choice(
        (
            (b"(", b"(0, "), (b"(", b"(-1, "), (b"(", b"(9223372036854775807, "), (b"4", b"4611686018427387904"),
            (b"<f8", b"<f4"), (b"<f8", b"|O"), (b"<f8", b">f8"), (b"<f8", b"<i8"), (b"<f8", b"<U9"),
            (b"False", b"True"), (b"'shape'", b"'shap'"), (b"{", b"[" * 500), (b"'<f8'", b"[('a', '<f8')]"),
            (b"(", b"(True, "), (b"(", b"((), "), (b"(", b"1" * 5000 + b", ("), (b"{", b"-" * 3000 + b"{"),
        )
    )  # fmt: skip
    changed = data.replace(old, new, 1)
    size = len(changed) - len(data) + int.from_bytes(data[8:10], "little")
    return changed[:8] + (size % (1 << 16)).to_bytes(2, "little") + changed[10:]


_VALUES = (
    "null", "0", "-1", "9223372036854775807", "-9223372036854775808", "1e999", "'text'", "x'00'", "zeroblob(9)",
    "zeroblob(100000)", "randomblob(60)", "''", "cast(x'ff1b0a' as text)", "hex(zeroblob(3000))",
)  # fmt: skip
_COLUMNS = (
    "topics.id", "topics.name", "topics.type", "topics.serialization_format", "topics.offered_qos_profiles",
    "topics.type_description_hash", "messages.id", "messages.topic_id", "messages.timestamp", "messages.data",
    "message_definitions.topic_type", "message_definitions.encoding", "schema.schema_version",
    "message_definitions.encoded_message_definition", "message_definitions.type_description_hash",
)  # fmt: skip
_STATEMENTS = (
    "drop table {t}", "alter table {t} rename to other", "alter table {t} drop column {c}", "delete from {t}",
    "alter table {t} rename column {c} to other",
    "insert into {t} select * from {t} where 0", "drop index timestamp_idx",
    "create view v as select * from {t}", "alter table {t} add column b as ({v})", "pragma user_version = 5",
    "drop table {t}; create table {t} (a)",
    "drop table {t}; create view {t} as select {v} as {c}, {v} as name, {v} as type",
)  # fmt: skip


def change_database(data: bytes, rng: random.Random) -> bytes:
    """Change a database by SQL, so that it stays one; give up on one that is not."""
    table, _, column = rng.choice(_COLUMNS).partition(".")
    value = rng.choice(_VALUES)
    if rng.random() < 0.7:
        where = "" if rng.random() < 0.5 else f" where rowid = {rng.randrange(4)}"
        statement = f"update or ignore {table} set {column} = {value}{where}"
    else:
        statement = rng.choice(_STATEMENTS).format(t=table, c=column, v=value)
    connection = sqlite3.connect(":memory:", isolation_level=None)
    try:
        connection.deserialize(data)
        connection.execute("pragma writable_schema = on")
        if rng.random() < 0.5:
            connection.execute("update sqlite_master set sql = replace(replace(sql, 'NOT NULL', ''), ' INTEGER', '')")
            data = connection.serialize()
            connection.deserialize(data)
        connection.executescript(statement)
        return connection.serialize()
    except Exception:  # noqa: BLE001
        return flip(data, rng)
    finally:
        connection.close()


# ---- seeds


def _carmen() -> Iterable[bytes]:
    flaser, configured, odom = carmen_files.flaser, carmen_files.configured, carmen_files.odom
    head = "# CARMEN Logfile\nPARAM robot_front_laser_max 30.0 p 0 host 0.1\n"
    yield (head + "\n".join([odom(0, 1, 2), flaser(), flaser(stamp=1000.5)]) + "\n").encode()
    yield "\n".join([configured(), configured(remissions=(1, 2, 3, 4)), odom(1, 1, 1), flaser()]).encode()
    raw = configured(tag="RAWLASER1")
    yield "\n".join([odom(1, 2, 0.5), raw, odom(2, 2, 0.6), raw, flaser(tag="RLASER")]).encode()


def _coreslam() -> Iterable[bytes]:
    row = " ".join(["7"] * 20) + " " + " ".join(["1500"] * 682)
    yield f"2500000 14710 0 0 {row} 0\n2600000 14710 9 7 {row} 0\n".encode()
    yield f"2500000 14710 0 0 {row}\n".encode()


def _csv() -> Iterable[bytes]:
    names = "stamp,angle_min,angle_increment,range_min,range_max,time_increment,scan_time"
    yield f"# a\n{names},x,y,theta,ranges\n1,-1,0.5,0,8,0,0.1,1,2,3,1.5,2,nan,\n2,-1,0.5,0,8,0,0.1,,,,1.5,2\n".encode()
    yield b"stamp,ranges\nangles,0,0.1,0.2\nintensities,1,2,3\n1,5,6,7\n2,5,6,7\n"


def _npz() -> Iterable[bytes]:
    arrays = {"stamps": np.arange(4.0), "ranges": np.ones((4, 3), dtype=np.float32)}
    even = {"angle_min": np.full(4, -1.0), "angle_increment": np.array(0.5)}
    odometry = {"odometry": np.ones((4, 3)), "counts": np.array([3, 2, 1, 0])}
    for more in (even | odometry, {"angles": np.arange(3.0), "intensities": np.ones((4, 3))}):
        for save in (np.savez, np.savez_compressed):
            file = io.BytesIO()
            save(file, **arrays, **more)  # type: ignore[operator]
            yield file.getvalue()


def _entries() -> list[bags.Entry]:
    drive = [bags.odometry(1, (0, 0, 0)), bags.odometry(3 * bags.SECOND, (1, 0, 1))]
    tf = [bags.transform(1, "odom", "base_link"), bags.transform(1, "base_link", "laser")]
    scans = [bags.scan(bags.SECOND), bags.scan(2 * bags.SECOND, intensities=(1, 2, 3))]
    return [scans[0], *drive, *tf, bags.imu(1, 0.1), scans[1]]


def _bag(folder: Path, kind: str) -> Iterable[bytes]:
    for i, entries in enumerate(([bags.scan(1), bags.scan(2)], _entries(), [bags.scan(0), bags.scan(0)])):
        yield bags.storage(bags.write_bag(folder / f"{kind}{i}", kind, entries)).read_bytes()


def _ros1(folder: Path) -> Iterable[bytes]:
    yield from _bag(folder, "ros1")
    for compression in Ros1Writer.CompressionFormat:
        writer = Ros1Writer(folder / f"{compression.value}.bag")
        writer.set_compression(compression)
        yield _packed(writer, bags.ROS1, bags.ROS1.serialize_ros1)


def _mcap(folder: Path) -> Iterable[bytes]:
    yield from _bag(folder, "mcap")
    writer = Ros2Writer(folder / "packed", version=8, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    packed = _packed(writer, bags.ROS2, bags.ROS2.serialize_cdr)
    yield packed
    # without summary: the reader goes through the records
    yield packed[:-28] + bytes(8) + packed[-20:]


def _packed(writer: Ros1Writer | Ros2Writer, store: object, serialize: Callable[..., bytes]) -> bytes:  # fmt: skip
    topic, msgtype, _, fields = bags.scan()
    with writer:
        connection = writer.add_connection(topic, msgtype, typestore=store)  # type: ignore[arg-type]
        for i in (1, 2):
            message = bags.build(store, msgtype, fields)
            writer.write(connection, i, serialize(message, msgtype))  # type: ignore[arg-type]
    return bags.storage(Path(writer.path)).read_bytes()


_TUM = b"# stamp x y z qx qy qz qw\n1.5 0 0 0 0 0 0 1\n2.5 1 2 0 0 0 0.6 0.8\nnan nan nan 0 0 0 nan nan\n"
_TRAJECTORY = (
    b"stamp,x,y,theta,cov_xx,cov_xy,cov_xt,cov_yy,cov_yt,cov_tt,outcome\n"
    b"1.5,0,0,0,,,,,,,ok\n" + b"2.5,1,2,0.5,1,0,0,1,0,1,ok\n" * 9
)
_POSES = b"# a\ntimestamp,x,y,theta,more\n1.5,0,0,0,a\n2.5,1,2,0.5,\n"
_RELATIONS = b"# t1 t2 x y z roll pitch yaw\n1 2 0.5 0 0 0 0 0.1\n2 3 0.5 0 0 0 0.01 -3\n"


def targets(folder: Path) -> dict[str, Callable[[], Target]]:
    """Return what makes each target, by name; the seeds that need files are written into a folder."""

    def log(row: str, seeds: Callable[[], Iterable[bytes]], *mutations: Mutation) -> Target:
        return Target(read=partial(_read_log, row), seeds=tuple(seeds()), mutations=mutations)

    def text(read: Callable[[Path], object], *seeds: bytes) -> Target:
        return Target(read=lambda path, _: void(read(path)), seeds=seeds, mutations=TEXT)

    def void(_: object) -> None:
        return None

    def config() -> Target:
        path = folder / "config.toml"
        write_config(path, config_tables())
        whole = path.read_bytes()
        small = b'[curvescan]\n[idc]\niterations = 3\n[cfsma.segmentation]\nx = [1.0, "a"]\n'
        return Target(read=_read_config, seeds=(whole, small), mutations=TEXT)

    sql: tuple[Mutation, ...] = (*BYTES, *(change_database,) * 8)
    return {
        "carmen": lambda: log("CARMEN log", _carmen, *TEXT),
        "coreslam": lambda: log("CoreSLAM log", _coreslam, *TEXT),
        "csv": lambda: log("CSV of scans", _csv, *TEXT),
        "npz": lambda: log("NPZ of scans", _npz, flip, put_integer, cut, *(change_member,) * 20),
        "ros1": lambda: log("ROS 1 bag", partial(_ros1, folder), *BYTES),
        "sqlite3": lambda: log("ROS 2 bag (sqlite3)", partial(_bag, folder, "sqlite3"), *sql),
        "mcap": lambda: log("ROS 2 bag (MCAP)", partial(_mcap, folder), *BYTES),
        "tum": lambda: text(read_tum, _TUM),
        "trajectory_csv": lambda: text(read_csv, _TRAJECTORY),
        "poses": lambda: text(read_poses, _TUM, _TRAJECTORY, _POSES),
        "relations": lambda: text(read_relations, _RELATIONS),
        "config": config,
    }
