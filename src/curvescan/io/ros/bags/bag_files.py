"""The files of a ROS bag: which kind they are, which of a folder belong together, and how they are unpacked.

A ROS 2 bag is a folder with its storage in one file, or in several that follow each other: ``name_0.db3``,
``name_1.db3``. The storage is found by its content; ``metadata.yaml`` repeats what the storage says and is not
needed. A gzip-compressed storage is unpacked to a temporary file, for its readers jump to and fro.
"""

import re
from contextlib import suppress
from enum import Enum
from pathlib import Path

from curvescan.errors import LogFileError, LogFormatError
from curvescan.io.files.lines import read_head

_MAGIC_BYTES = 16


class BagKind(Enum):
    """How a ROS bag stores its messages; the value names it in words."""

    ROS1 = "ROS 1 bag"
    SQLITE = "ROS 2 bag (sqlite3)"
    MCAP = "ROS 2 bag (MCAP)"

    def begins(self, head: bytes) -> bool:
        """Return whether the first bytes of a file, unpacked, are those of this kind."""
        return head.startswith(_MAGICS[self])


_MAGICS = {BagKind.ROS1: b"#ROSBAG V", BagKind.SQLITE: b"SQLite format 3\x00", BagKind.MCAP: b"\x89MCAP0\r\n"}


def bag_kind(path: Path) -> BagKind | None:
    """Return the kind of bag in a file, plain or gzip-compressed; None when it is none."""
    head = read_head(path, _MAGIC_BYTES)
    return next((kind for kind in BagKind if kind.begins(head)), None)


def storage_files(folder: Path) -> tuple[Path, ...]:
    """Return the storage files of a ROS 2 bag folder, in the order they were recorded."""
    try:
        entries = sorted(entry for entry in folder.iterdir() if entry.is_file())
    except OSError as error:
        raise LogFileError(f"cannot read folder {folder}: {error.strerror or error}") from error
    kinds: dict[Path, BagKind] = {}
    for entry in entries:
        with suppress(LogFileError, LogFormatError):  # what cannot be read is no bag
            kind = bag_kind(entry)
            if kind in (BagKind.SQLITE, BagKind.MCAP):
                kinds[entry] = kind
    if not kinds:
        raise LogFileError(_no_bag_message(folder))
    if len({(kind, _split_name(file)[0]) for file, kind in kinds.items()}) > 1:
        names = ", ".join(file.name for file in list(kinds)[:8])
        raise LogFormatError(f"{folder} holds several bags: give one of them ({names})")
    return tuple(sorted(kinds, key=lambda file: _split_name(file)[1]))


def recorded_counts(folder: Path) -> dict[str, int]:
    """Return how many messages a ROS 2 bag has by topic, by the metadata.yaml in its folder; empty without one."""
    text = ""
    with suppress(OSError, UnicodeDecodeError):
        text = (folder / "metadata.yaml").read_text("utf-8")
    topics = re.search(r"^ *topics_with_message_count:\n( *)- ", text, re.M)
    counts: dict[str, int] = {}
    for entry in re.split(rf"^{topics[1]}- ", text[topics.start() :], flags=re.M) if topics else ():
        name = re.search(r"^ *name: (\S+)$", entry, re.M)
        count = re.search(r"^ *message_count: (\d{1,12})$", entry, re.M)
        if name and count:
            counts[name[1]] = int(count[1])
    return counts


def _split_name(file: Path) -> tuple[str, int]:
    """Return the name without number and endings, and the number: ("run", 2) for run_2.db3.gz."""
    stem = re.sub(r"(\.(db3|mcap|gz))+$", "", file.name)
    match = re.fullmatch(r"(.*)_(\d{1,9})", stem)
    return (match[1], int(match[2])) if match else (stem, -1)


def _no_bag_message(folder: Path) -> str:
    if (folder / "metadata.yaml").is_file():
        return (
            f"{folder} is the folder of a ROS 2 bag, by its metadata.yaml, without a storage file that can be "
            "read: it needs its .db3 or .mcap (plain or gzip-compressed; unpack other compression first)"
        )
    return (
        f"a log must be a file or the folder of a ROS 2 bag, and {folder} is a folder without one: "
        "give the path of a log inside it"
    )
