"""A matcher that finds what a script says, so that the odometry is tested alone."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

import curvescan as cs
from curvescan import se2
from curvescan.matchers.registry import MATCHERS

METHOD = "scripted"
_N_BEAMS = 4


@dataclass(frozen=True, kw_only=True, eq=False)
class Script:
    """True poses of scans by number, scans that match nothing, and pairs with a score and confidence of their own.

    A pair of score 0 is not matched. Sudden scans match only where a prior knows a turn no better than 1 rad.
    """

    poses: np.ndarray = field(default_factory=lambda: np.zeros((1, 3)))
    hidden: frozenset[int] = frozenset()
    links: dict[tuple[int, int], tuple[float, float]] = field(default_factory=dict)
    sudden: frozenset[int] = frozenset()


class ScriptedMatcher:
    """Finds the true pose of any two scans that are not hidden."""

    def __init__(self, config: Script) -> None:
        self.config = config

    def prepare(self, scan):
        return round(scan.stamp)

    def can_be_reference(self, features):
        return True

    def match(self, reference, current, guess):
        score, confidence = self.config.links.get((reference, current), (0.8, 0.98))
        is_seen = score > 0.0 and not {reference, current} & self.config.hidden
        is_seen &= current not in self.config.sudden or (guess is not None and guess.covariance[2, 2] >= 1.0)
        pose = se2.between(self.config.poses[reference], self.config.poses[current])
        return cs.MatchResult(
            method=METHOD,
            outcome=cs.Outcome.MATCHED if is_seen else cs.Outcome.UNSUPPORTED,
            pose=pose if is_seen else np.full(3, np.nan),
            covariance=np.diag([1e-6, 1e-6, 1e-8]) if is_seen else np.full((3, 3), np.nan),
            n_matched=200 * is_seen,
            trace=None,
            labels_reference=np.zeros(_N_BEAMS, dtype=np.uint8),
            labels_current=np.zeros(_N_BEAMS, dtype=np.uint8),
            score=score if is_seen else np.nan,
            confidence=confidence if is_seen else 0.0,
        )


def run(monkeypatch, poses, hidden=(), config=None, links=None, wheels=None, sudden=()):
    """Return the odometry after all scans of a script, and its steps."""
    row = f"{__name__}:ScriptedMatcher", f"{__name__}:Script"
    monkeypatch.setitem(MATCHERS, METHOD, row)
    poses, hidden, sudden = np.asarray(poses, dtype=float), frozenset(hidden), frozenset(sudden)
    script = Script(poses=poses, hidden=hidden, links=links or {}, sudden=sudden)
    odometry = cs.Odometry(METHOD, config=config or cs.OdometryConfig(), matcher=script)
    scans = [
        cs.LaserScan(np.ones(_N_BEAMS), angle_min=0.0, angle_increment=0.1, stamp=float(k)) for k in range(len(poses))
    ]
    wheels = [None] * len(scans) if wheels is None else wheels
    return odometry, [odometry.add(*pair) for pair in zip(scans, wheels, strict=True)]
