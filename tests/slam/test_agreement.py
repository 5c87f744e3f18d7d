"""Agreement: which sets of closures that wait are accepted."""

from __future__ import annotations

import dataclasses

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


def test_what_was_accepted_speaks_against_other_places_and_for_its_own() -> None:
    """A second lap begins: true ones first, then twice as many matches with the next room."""
    true = [_closure(i, i + 30, 0.1) for i in range(4)]
    lookalikes = [_closure(4 + i, 31 + i // 2, 1.9, ROOM) for i in range(6)]
    waiting = Waiting(SlamConfig())
    assert len([c for one in true for c in waiting.add(one, POSES)]) == 4
    # one more that agrees with those accepted needs no others
    assert len(waiting.add(_closure(5, 35, 0.1), POSES)) == 1
    waiting.optimize()
    assert not [c for one in lookalikes[:5] for c in waiting.add(one, POSES)]
    # after the optimization the graph itself expects them elsewhere
    waiting.adopt()
    assert len(waiting.add(lookalikes[5], POSES)) == 6


def test_a_log_that_ends_as_its_loop_closes_waits_for_no_further_view() -> None:
    def concluded(closures: list[Closure]) -> int:
        waiting = Waiting(SlamConfig())
        assert not [c for one in closures for c in waiting.add(one, POSES)]
        return len(waiting.conclude(POSES))

    last = N - 1
    of_last = [_closure(i, last, 0.1) for i in range(3)]
    assert concluded(of_last) == 3
    assert concluded(of_last[:2]) == 0
    assert concluded([dataclasses.replace(c, is_doubtful=True) for c in of_last]) == 0
    assert concluded([dataclasses.replace(c, j=last - 1) for c in of_last]) == 0


def test_three_that_agree_wait_where_two_agree_on_another_place() -> None:
    lookalikes = [_closure(i, i + 30, 1.9, ROOM) for i in range(3)]
    assert len(_accepted(lookalikes)) == 3
    others = [_closure(4 + i, 30 + i, 0.1) for i in range(2)]
    assert len(_accepted([*others, *lookalikes])) == 0
