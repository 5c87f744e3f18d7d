"""The logs of a batch: which ones patterns name, on this machine and in buckets, and the names of their results."""

import fnmatch
import glob
import hashlib
import os
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from curvescan.errors import InvalidArgumentError, LogFileError, LogFormatError
from curvescan.io.ros.bags.bag_files import storage_files
from curvescan.runs.batch.object_store import Bucket, StoredObject, is_url, split_url

BAG_MARK = "metadata.yaml"  # a folder of a bucket that holds this file is a ROS 2 bag, which is one log


@dataclass(frozen=True, kw_only=True)
class LogState:
    """What identifies a log as the one that was run."""

    input: str  # absolute path of the file or folder, or its URL
    bytes: int  # its size
    mtime_ns: int  # when it was changed last, nanoseconds; 0 in a bucket
    etag: str = ""  # what identifies its content in a bucket; else empty

    @classmethod
    def of(cls, log: Path) -> "LogState":
        """Return the state of a log on this machine now; size and time are 0 where it cannot be read."""
        try:
            files = storage_files(log) if log.is_dir() else (log,)
            stats = [file.stat() for file in files]
        except (OSError, LogFileError, LogFormatError):
            return cls(input=str(log), bytes=0, mtime_ns=0)
        size, changed = sum(s.st_size for s in stats), max(s.st_mtime_ns for s in stats)
        return cls(input=str(log), bytes=size, mtime_ns=changed)

    @classmethod
    def of_objects(cls, url: str, objects: Sequence[StoredObject]) -> "LogState":
        """Return the state of a log that is one object of a bucket, or several."""
        tags = "\n".join(f"{found.key} {found.tag}" for found in objects)
        tag = objects[0].tag if len(objects) == 1 else hashlib.sha256(tags.encode()).hexdigest()
        return cls(input=url, bytes=sum(o.size for o in objects), mtime_ns=0, etag=tag)


def find_logs(patterns: Iterable[str | os.PathLike[str]]) -> tuple[LogState, ...]:
    """Return the logs that patterns match, each once, in the order of their absolute paths or URLs.

    A folder that holds a ROS 2 bag is a log, and the files in it are not. A path without wildcards is taken as it is.
    """
    paths: dict[Path, None] = {}
    remote: dict[str, LogState] = {}
    buckets: dict[str, Bucket] = {}
    for pattern in patterns:
        if is_url(pattern):
            address, key = split_url(os.fspath(pattern))
            bucket = buckets.get(address) or buckets.setdefault(address, Bucket(address))
            states = _find_objects(bucket, key)
            remote |= {state.input: state for state in states}
            found = len(states)
        else:
            matched = _find_paths(os.fspath(pattern))
            paths |= dict.fromkeys(matched)
            found = len(matched)
        if not found:
            raise InvalidArgumentError(
                f"no log matches {os.fspath(pattern)!r}: give the path of a log, or a pattern such as 'logs/**/*.bag'"
            )
    if not (paths or remote):
        raise InvalidArgumentError(
            "a batch needs at least one log: give its path, or a pattern such as 'logs/**/*.bag'"
        )
    bags = {path for path in paths if path.is_dir()}
    local = sorted(path for path in paths if path.parent not in bags)
    return (*map(LogState.of, local), *(remote[url] for url in sorted(remote)))


def _find_paths(pattern: str) -> list[Path]:
    text = os.path.expanduser(pattern)  # noqa: PTH111 - a pattern is no path
    if Path(text).exists():
        found = [Path(text)]
    else:
        found = []
        for path in map(Path, glob.glob(text, recursive=True)):  # noqa: PTH207 - of absolute patterns too
            with suppress(LogFileError, LogFormatError):  # a folder without a bag
                if not path.is_dir() or storage_files(path):
                    found.append(path)
    return [Path(os.path.abspath(path)) for path in found]  # noqa: PTH100 - keeps links


def _find_objects(bucket: Bucket, pattern: str) -> list[LogState]:
    if (one := bucket.find(pattern)) is not None:
        return [LogState.of_objects(f"{bucket.address}/{one.key}", [one])]
    segments = pattern.split("/")
    fixed = next((k for k, part in enumerate(segments) if glob.has_magic(part)), len(segments))
    objects = {found.key: found for found in bucket.list("/".join(segments[:fixed]))}
    parents = {key.rpartition("/")[0] for key in objects}
    bags = {parent for parent in parents if f"{parent}/{BAG_MARK}" in objects}
    names = [key for key in objects if key.rpartition("/")[0] not in bags] + sorted(bags)
    states = []
    for name in names:
        if _matches(name.split("/"), segments):
            parts = [o for key, o in objects.items() if (key.rpartition("/")[0] if name in bags else key) == name]
            states.append(LogState.of_objects(f"{bucket.address}/{name}", parts))
    return states


def _matches(names: Sequence[str], patterns: Sequence[str]) -> bool:
    """Return whether a key matches a pattern, both cut at ``/``: ``**`` is any number of folders, as in `glob`."""
    if not patterns:
        return not names
    if patterns[0] == "**":
        rest = patterns[1:] or ("*",)
        return any(
            _matches(names[k:], rest) for k in range(len(names)) if not any(name.startswith(".") for name in names[:k])
        )
    if not names or (names[0].startswith(".") and not patterns[0].startswith(".")):
        return False
    return fnmatch.fnmatchcase(names[0], patterns[0]) and _matches(names[1:], patterns[1:])


def name_folders(logs: Sequence[str], known: dict[str, str], reserved: Sequence[str] = ()) -> dict[str, str]:
    """Return the name of each log's results folder: the log's name, after its parent folders' where that is taken."""
    taken = {name.casefold() for name in (*known.values(), *reserved)}
    folders: dict[str, str] = {}
    for log in logs:
        name = known.get(log)
        if name is None:
            name = next(name for name in _names(log) if name.casefold() not in taken)
            taken.add(name.casefold())
        folders[log] = name
    return folders


def unique_name(log: str) -> str:
    """Return a name of the results' folder that no other log has, whoever else is naming folders meanwhile."""
    return f"{_stem(log)}-{hashlib.sha256(log.encode()).hexdigest()[:8]}"


def _names(log: str) -> Iterator[str]:
    name = _stem(log)
    yield name
    for parent in _as_path(log).parents:
        if parent.name:
            name = f"{parent.name.lstrip('.')}-{name}"
            yield name
    for k in range(2, 1_000_000):
        yield f"{name}-{k}"


def _stem(log: str) -> str:
    path = _as_path(log)
    is_folder = isinstance(path, Path) and path.is_dir()
    stem = path.name if is_folder else re.sub(r"(\.\w{1,6})?(\.gz)?$", "", path.name)
    return re.sub(r"[\\:\x00-\x1f]", "_", stem or path.name).lstrip(".") or "log"


def _as_path(log: str) -> Path | PurePosixPath:
    return PurePosixPath(split_url(log)[1]) if is_url(log) else Path(log)
