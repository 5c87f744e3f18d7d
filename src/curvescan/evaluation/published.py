"""Published errors on the logs of the Freiburg SLAM benchmark, to stand beside those measured here.

R. Kümmerle, B. Steder, C. Dornhege, M. Ruhnke, G. Grisetti, C. Stachniss, A. Kleiner, "On measuring the accuracy of
SLAM algorithms", Autonomous Robots 27 (2009) 387-407: the tables of absolute translational and rotational errors, mean
and standard deviation over all relations of a log. "Scan matching" there is the open-loop trajectory of consecutive
scans matched, "RBPF" a Rao-Blackwellised particle filter (GMapping), "graph mapping" an optimised pose graph; the last
two close loops. Of the rotational errors only Intel's are given: the others could not be checked against a source.
"""

from __future__ import annotations

from dataclasses import dataclass

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


_CARTOGRAPHER: dict[str, tuple[tuple[float, float], float]] = {
    "ACES": ((0.0375, 0.0426), 0.373),
    "Intel": ((0.0229, 0.0239), 0.453),
    "MIT Killian Court": ((0.0395, 0.0488), 0.352),
    "Freiburg 079": ((0.0452, 0.0354), 0.538),
}
"""Hess, Kohler, Rapp and Andor, "Real-time loop closure in 2D LIDAR SLAM", ICRA 2016: mean and standard deviation of
the translation, metres, and mean of the rotation, degrees; with wheel odometry, and parameters tuned for each
sensor."""

_METHODS = ("scan matching", "RBPF", "graph mapping")


def _benchmark(
    name: str,
    keys: tuple[str, ...],
    translation: tuple[tuple[float, float], ...],
    rotation: tuple[tuple[float, float], ...] | None = None,
) -> BenchmarkLog:
    rotations = rotation or (None,) * len(_METHODS)
    return BenchmarkLog(
        name=name,
        keys=keys,
        errors=tuple(
            PublishedError(method=method, translation=metres, rotation=degrees)
            for method, metres, degrees in zip(_METHODS, translation, rotations, strict=True)
        )
        + _cartographer(name),
    )


def _cartographer(name: str) -> tuple[PublishedError, ...]:
    if name not in _CARTOGRAPHER:
        return ()
    metres, degrees = _CARTOGRAPHER[name]
    method = "Cartographer, ICRA 2016 (wheels, tuned)"
    return (PublishedError(method=method, translation=metres, rotation=(degrees, None)),)


BENCHMARKS: dict[str, BenchmarkLog] = {
    "aces": _benchmark("ACES", ("aces",), ((0.173, 0.614), (0.060, 0.049), (0.044, 0.044))),
    "intel": _benchmark(
        "Intel", ("intel",), ((0.220, 0.296), (0.070, 0.083), (0.031, 0.026)), ((1.7, 4.8), (3.0, 5.3), (1.3, 4.7))
    ),
    "mit-killian-court": _benchmark(
        "MIT Killian Court", ("killian",), ((1.651, 4.138), (0.122, 0.386), (0.050, 0.056))
    ),
    "mit-csail": _benchmark("MIT CSAIL", ("csail",), ((0.106, 0.325), (0.049, 0.049), (0.004, 0.009))),
    "freiburg-079": _benchmark(
        "Freiburg 079",
        ("fr079", "fr-079", "freiburg-079", "freiburg079"),
        ((0.258, 0.427), (0.061, 0.044), (0.056, 0.042)),
    ),
    "freiburg-hospital": _benchmark(
        "Freiburg hospital", ("hospital",), ((0.434, 1.615), (0.637, 2.638), (0.143, 0.180))
    ),
}
"""The logs of the benchmark by name."""


def find_benchmark(name: str | None, file_name: str = "") -> BenchmarkLog | None:
    """Return the benchmark of that name, or that the name of a file contains; None without one."""
    if name is not None:
        if name not in BENCHMARKS:
            raise InvalidArgumentError(f"there is no benchmark {name!r}; known are {', '.join(BENCHMARKS)}")
        return BENCHMARKS[name]
    words = file_name.lower().replace("_", "-")
    return next((b for b in BENCHMARKS.values() if any(key in words for key in b.keys)), None)
