"""Lines of CARMEN logs, written out for the tests of the reader."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

RANGES = (1.0, 2.5, 81.83, 4.25)


def flaser(
    ranges: Sequence[object] = RANGES,
    *,
    stamp: object = 1000.25,
    laser: Sequence[object] = (1.5, -2.0, 0.25),
    count: object = None,
    tag: str = "FLASER",
) -> str:
    n = len(ranges) if count is None else count
    return " ".join(map(str, [tag, n, *ranges, *laser, 9, 9, 9, stamp, "host", 0.5]))


def configured(
    ranges: Sequence[object] = RANGES,
    *,
    tag: str = "ROBOTLASER1",
    start: object = -1.0,
    fov: object = 1.5,
    resolution: object = 0.5,
    max_range: object = 30.0,
    remissions: Sequence[object] = (),
    laser: Sequence[object] = (1.5, -2.0, 0.25),
    stamp: object = 1000.25,
) -> str:
    pose = [*laser, 8, 8, 8, 0, 0, 0, 0, 0] if tag.startswith("ROBOT") else []
    head = [tag, 0, start, fov, resolution, max_range, 0.01, 0]
    fields = [*head, len(ranges), *ranges, len(remissions), *remissions, *pose, stamp, "host", 0.5]
    return " ".join(map(str, fields))


def odom(x: object, y: object, theta: object) -> str:
    return f"ODOM {x} {y} {theta} 0 0 0 1000.5 host 0.5"


def write(path: Path, *lines: str, end: str = "\n") -> Path:
    path.write_bytes("".join(line + end for line in lines).encode())
    return path
