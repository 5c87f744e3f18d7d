"""Agreement: the odds of sets of matches that agree, and of those that contradict them."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from curvescan import se2
from curvescan.slam import SlamConfig
from curvescan.slam.loops.agreement import MOST_LOG_ODDS, best_group, largest_clique
from curvescan.slam.loops.closures import MOST_ODDS, Closure, ClosureOutcome
from curvescan.slam.loops.cycles import Chain
from curvescan.types import Pose

CONFIG = SlamConfig()
N = 40
POSES: Pose = np.column_stack((0.5 * np.arange(N), np.zeros(N), np.zeros(N)))
"""A corridor; the last keyframes are to be tied to the first ones."""

CHAIN = Chain.of(POSES, np.tile(np.diag([2.5e-5, 2.5e-5, 4e-6]), (N, 1, 1)))

ROOM = np.array([3.7, 0.0, 0.0])
"""To the next room, which looks the same."""


def _closure(i: int, j: int, off: Pose | float = 0.0, expectation: float = 3.0, confidence: float = 0.98) -> Closure:
    """A match that agrees with the chain but for `off`; what the graph says of it is given."""
    return Closure(
        scan=j, i=i, j=j, pose=se2.between(POSES[i], POSES[j]) + off,
        covariance=np.diag(np.square([0.01, 0.01, 0.005])),
        score=0.9, distance=1.0, outcome=ClosureOutcome.WAITING, confidence=confidence, expectation=expectation,
    )  # fmt: skip


def _lead(pool: list[Closure], chain: Chain = CHAIN) -> tuple[int, float]:
    """Return how many agree with the last of a pool, and their log odds less those of what contradicts them."""
    members, lead = best_group(pool, chain, CONFIG)
    return len(members), lead


def test_views_a_step_apart_say_little_more_than_one() -> None:
    one = _lead([_closure(0, 30)])[1]
    near = _lead([_closure(0, 30), _closure(1, 31)])[1]
    far = _lead([_closure(0, 30), _closure(4, 34)])[1]
    assert one < near < far
    own = math.log(0.98 / 0.02)
    np.testing.assert_allclose([one - 3.0, near - 3.0, far - 3.0], [own, 1.25 * own, 2.0 * own])


@pytest.mark.parametrize(("confidence", "share"), [(0.999, 1.0), (0.95, math.log(19.0) / MOST_ODDS)])
def test_a_stretch_that_looks_alike_is_no_surer_the_longer_it_is(confidence: float, share: float) -> None:
    """Nor does it say more than its surest match lets it: one among pillars on a grid, all in doubt, none."""
    n, odds = _lead([_closure(k, 20 + k, ROOM, confidence=confidence) for k in range(0, 20, 2)])
    assert n == 10
    np.testing.assert_allclose(odds, share * MOST_LOG_ODDS + 3.0)


@pytest.mark.parametrize("expectation", [-1.0, 0.0, 2.8])
def test_corridors_that_look_alike_all_along_close_nothing_that_the_graph_does_not_expect(expectation) -> None:
    """ACES: a fragment was joined by 17 views of another corridor, of which each was likely; Duke's end, by nine."""
    along = np.diag([3600.0, 1e-4, 2.5e-5])
    pool = [replace(_closure(k, 20 + k, expectation=expectation), covariance=along) for k in range(0, 20, 2)]
    n, odds = _lead(pool)
    assert n == 10
    np.testing.assert_allclose(odds, CONFIG.closures.log_odds + expectation)
    # and in doubt, each of them, they say less than that
    n, odds = _lead([replace(c, confidence=0.75) for c in pool])
    assert n == 10
    np.testing.assert_allclose(odds, MOST_LOG_ODDS * math.log(3.0) / MOST_ODDS + expectation)


def test_of_a_set_the_graph_has_to_expect_what_is_new() -> None:
    """What was accepted was expected: it may not bring in what the graph does not expect."""
    accepted = [replace(_closure(i, i + 30, expectation=12.0), outcome=ClosureOutcome.ACCEPTED) for i in (0, 2, 4)]
    n, lead = _lead([*accepted, _closure(6, 36, expectation=-8.0, confidence=0.55)])
    assert n == 4
    assert lead < CONFIG.closures.log_odds
    assert _lead([*accepted, _closure(6, 36, expectation=3.0)])[1] > CONFIG.closures.log_odds


def test_what_contradicts_a_set_has_its_own_odds() -> None:
    true = [_closure(i, i + 30, expectation=10.0) for i in (0, 4)]
    lookalikes = [_closure(3 + i, 30 + i, ROOM, expectation=1.0) for i in (0, 2, 4)]
    n, lead = _lead([*true, *lookalikes])
    assert n == 3
    assert lead < 0.0
    n, lead = _lead([*lookalikes, *true])
    assert n == 2
    assert lead > CONFIG.closures.log_odds


def _slipped(row: int, sigma_m: float) -> Chain:
    """Return the chain where the odometry does not know how far it came to a keyframe."""
    motions = np.tile(np.diag([2.5e-5, 2.5e-5, 4e-6]), (N, 1, 1))
    motions[row, 0, 0] = sigma_m**2
    return Chain.of(POSES, motions)


def test_closures_agree_across_a_step_that_is_known_to_decimetres() -> None:
    pool = [_closure(0, 30), _closure(1, 30), _closure(3, 31, np.array([0.2, 0.0, 0.0]))]
    assert _lead(pool)[0] == 1
    assert _lead(pool, _slipped(31, 0.1))[0] == 3
    # one known no better than what may guide a match would lead to the next room as well
    assert _lead(pool, _slipped(31, 1.1 * CONFIG.closures.certain_m))[0] == 1


def test_what_leaves_a_way_open_agrees_with_its_like_alone() -> None:
    """Views along a corridor fit both rooms: they do not help the one that looks like the other."""
    along = np.diag([4e3, 1e-4, 2.5e-5])
    corridor = [replace(_closure(k, 30 + k), covariance=along) for k in (0, 4, 8)]
    lookalike = _closure(2, 32, ROOM)
    assert _lead([*corridor, lookalike])[0] == 1
    assert _lead([lookalike, *corridor])[0] == 3


@pytest.mark.parametrize("seed", range(8))
def test_a_clique_is_as_large_as_the_one_found_by_trying_all(seed: int) -> None:
    rng = np.random.default_rng(seed)
    links = rng.random((9, 9)) < 0.5
    links = links | links.T

    def is_clique(rows: tuple[int, ...]) -> bool:
        return all(links[a, b] for a, b in itertools.combinations(rows, 2))

    sizes = [size for size in range(10) if any(map(is_clique, itertools.combinations(range(9), size)))]
    found = largest_clique(links)
    assert is_clique(tuple(found))
    assert len(found) == max(sizes)


def test_of_no_rows_the_clique_is_empty() -> None:
    assert len(largest_clique(np.zeros((0, 0), dtype=np.bool_))) == 0
