"""Agreement: which sets of closures that wait are accepted."""

from __future__ import annotations

import dataclasses

import numpy as np

from curvescan import se2
from curvescan.slam import SlamConfig
from curvescan.slam.loops.agreement import Waiting
from curvescan.slam.loops.closures import Closure, ClosureOutcome
from curvescan.slam.loops.cycles import Chain
from curvescan.types import Pose

N = 40
POSES: Pose = np.column_stack((0.5 * np.arange(N), np.zeros(N), np.zeros(N)))
"""A corridor; the last keyframes are to be tied to the first ones."""

CHAIN = Chain.of(POSES, np.tile(np.diag([2.5e-5, 2.5e-5, 4e-6]), (N, 1, 1)))

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
    return [c for one in closures for c in waiting.add(one, CHAIN)]


def test_three_that_agree_are_accepted() -> None:
    given = [_closure(i, i + 30, 0.1) for i in range(3)]
    assert len(_accepted(given[:2])) == 0
    assert len(_accepted(given)) == 3


def test_what_was_accepted_speaks_against_other_places_and_for_its_own() -> None:
    """A second lap begins: true ones first, then more than twice as many matches with the next room."""
    true = [_closure(i, i + 30, 0.1) for i in range(4)]
    lookalikes = [_closure(4 + i, 31 + i // 2, 1.9, ROOM) for i in range(10)]
    waiting = Waiting(SlamConfig())
    assert len([c for one in true for c in waiting.add(one, CHAIN)]) == 4
    # one more that agrees with those accepted needs no others
    assert len(waiting.add(_closure(5, 35, 0.1), CHAIN)) == 1
    # what contradicts them is not taken, however many
    assert not [c for one in lookalikes for c in waiting.add(one, CHAIN)]
    waiting.optimize()
    waiting.adopt()
    # after the optimization the graph itself expects them elsewhere
    assert len([c for one in lookalikes for c in waiting.add(one, CHAIN)]) == 10


def test_what_an_optimization_did_not_know_speaks_on_after_it() -> None:
    """Closures that were tried before it began and accepted after."""
    true = [_closure(i, i + 30, 0.1) for i in range(3)]
    lookalikes = [_closure(4 + i, 31 + i // 2, 1.9, ROOM) for i in range(6)]
    waiting = Waiting(SlamConfig())
    assert not [c for one in true[:2] for c in waiting.add(one, CHAIN)]
    waiting.optimize()
    assert len(waiting.add(dataclasses.replace(true[2], scan=0), CHAIN)) == 3
    waiting.adopt()
    assert not [c for one in lookalikes for c in waiting.add(one, CHAIN)]


def _slipped(row: int, sigma_m: float) -> Chain:
    """Return the chain where the odometry does not know how far it came to a keyframe."""
    motions = np.tile(np.diag([2.5e-5, 2.5e-5, 4e-6]), (N, 1, 1))
    motions[row, 0, 0] = sigma_m**2
    return Chain.of(POSES, motions)


def test_closures_agree_across_a_step_that_is_known_to_decimetres() -> None:
    before = [_closure(0, 30, 0.1), _closure(1, 30, 0.1)]
    after = _closure(3, 31, 0.1, np.array([0.2, 0.0, 0.0]))

    def n_accepted(chain: Chain) -> int:
        waiting = Waiting(SlamConfig())
        return len([c for one in (*before, after) for c in waiting.add(one, chain)])

    assert n_accepted(CHAIN) == 0
    assert n_accepted(_slipped(31, 0.1)) == 3
    # one known to half a metre would lead to the next room as well
    assert n_accepted(_slipped(31, 0.5)) == 0


def test_what_was_accepted_contradicts_nothing_beyond_a_slip() -> None:
    chain = _slipped(34, 2.0)
    true = [_closure(i, i + 30, 0.1) for i in range(4)]
    moved = [_closure(6 + i, 35 + i // 2, 0.1, ROOM) for i in range(8)]
    waiting = Waiting(SlamConfig())
    assert len([c for one in true for c in waiting.add(one, chain)]) == 4
    assert len([c for one in moved for c in waiting.add(one, chain)]) == 8


def test_the_next_room_waits_while_matches_where_the_graph_has_them_contradict_it() -> None:
    """The keyframes match their own place and, by many more, a room that the graph can hardly have there."""
    likely = [_closure(0, 30, 0.0), _closure(1, 31, 0.0)]
    lookalikes = [dataclasses.replace(_closure(4 + i, 30 + i // 2, 2.0, ROOM), is_doubtful=True) for i in range(8)]

    def n_accepted(first: list[Closure]) -> int:
        waiting = Waiting(SlamConfig())
        return len([c for one in (*first, *lookalikes) for c in waiting.add(one, CHAIN)])

    assert n_accepted(likely) == 0
    assert n_accepted([]) == 8
    assert n_accepted(likely[:1]) == 8


def test_a_log_that_ends_as_its_loop_closes_waits_for_no_further_view() -> None:
    def concluded(closures: list[Closure]) -> int:
        waiting = Waiting(SlamConfig())
        assert not [c for one in closures for c in waiting.add(one, CHAIN)]
        return len(waiting.conclude(CHAIN))

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
