"""Agreement: which sets of closures that wait are accepted."""

from __future__ import annotations

import numpy as np

from curvescan import se2
from curvescan.slam import SlamConfig
from curvescan.slam.loops.agreement import Waiting
from curvescan.slam.loops.closures import Closure, ClosureOutcome
from curvescan.types import Pose

N = 40
POSES: Pose = np.column_stack((0.5 * np.arange(N), np.zeros(N), np.zeros(N)))
"""A corridor; the last keyframes are to be tied to the first ones."""

ROOM = np.array([3.7, 0.0, 0.0])
"""To the next room, which looks the same."""


def _closure(i: int, j: int, distance: float, off: Pose | float = 0.0) -> Closure:
    true = se2.between(POSES[i], POSES[j])
    return Closure(
        scan=j,
        i=i,
        j=j,
        pose=true + off,
        covariance=np.diag(np.square([0.01, 0.01, 0.005])),
        score=0.9,
        distance=distance,
        outcome=ClosureOutcome.WAITING,
        confidence=0.9,
    )


def _accepted(closures: list[Closure]) -> list[Closure]:
    waiting = Waiting(SlamConfig())
    return [c for one in closures for c in waiting.add(one, POSES)]


def test_three_that_agree_are_accepted() -> None:
    given = [_closure(i, i + 30, 0.1) for i in range(3)]
    assert len(_accepted(given[:2])) == 0
    assert len(_accepted(given)) == 3


def test_three_that_agree_wait_where_another_place_is_likelier() -> None:
    lookalikes = [_closure(i, i + 30, 1.9, ROOM) for i in range(3)]
    assert len(_accepted(lookalikes)) == 3
    likelier = _closure(3, 30, 0.1)
    assert len(_accepted([likelier, *lookalikes])) == 0


def test_a_likelier_place_is_accepted_beside_one_lookalike() -> None:
    lookalike = _closure(3, 30, 1.9, ROOM)
    found = _accepted([lookalike, *(_closure(i, i + 30, 0.1) for i in range(3))])
    assert {c.distance for c in found} == {0.1}
