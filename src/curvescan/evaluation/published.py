"""Published errors on the logs of the Freiburg SLAM benchmark, to stand beside those measured here.

Figures and sources stand in ``published.toml``.
"""

from __future__ import annotations

from dataclasses import dataclass

from curvescan.configs import shipped_table
from curvescan.errors import InvalidArgumentError

SOURCE = "Kümmerle et al., Autonomous Robots 27 (2009) 387-407, but for Cartographer's"


@dataclass(frozen=True, kw_only=True)
class PublishedError:
    """What one method reached on one log, over all of its relations."""

    method: str  # in words
    translation: tuple[float, float]  # mean and standard deviation, metres
    # mean and standard deviation, degrees, as far as they were published
    rotation: tuple[float, float | None] | None = None


@dataclass(frozen=True, kw_only=True)
class BenchmarkLog:
    """A log of the benchmark."""

    name: str  # in words
    keys: tuple[str, ...]  # A file whose name holds one of these belongs to it
    errors: tuple[PublishedError, ...]  # what was published


def _error(method: str, translation: list[float], rotation: list[float] | None = None) -> PublishedError:
    mean, std = translation
    degrees = None if rotation is None else (rotation[0], rotation[1] if len(rotation) > 1 else None)
    return PublishedError(method=method, translation=(mean, std), rotation=degrees)


def _read() -> dict[str, BenchmarkLog]:
    return {
        key: BenchmarkLog(name=row["name"], keys=tuple(row["keys"]), errors=tuple(_error(**e) for e in row["errors"]))
        for key, row in shipped_table(__package__, "published.toml").items()
    }


BENCHMARKS: dict[str, BenchmarkLog] = _read()
"""The logs of the benchmark by name."""


def find_benchmark(name: str | None, file_name: str = "") -> BenchmarkLog | None:
    """Return the benchmark of that name, or that the name of a file contains; None without one."""
    if name is not None:
        if name not in BENCHMARKS:
            raise InvalidArgumentError(f"there is no benchmark {name!r}; known are {', '.join(BENCHMARKS)}")
        return BENCHMARKS[name]
    words = file_name.lower().replace("_", "-")
    return next((b for b in BENCHMARKS.values() if any(key in words for key in b.keys)), None)
