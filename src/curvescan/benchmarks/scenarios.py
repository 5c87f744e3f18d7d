"""Matchers on thousands of simulated pairs, scenario by scenario: how far the motion, how many people, which sensor."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from curvescan import se2
from curvescan.benchmarks.cramer_rao import median_error, pair_bound
from curvescan.matchers import MatchResult, match
from curvescan.paper.random_transform import SUCCESS
from curvescan.simulation import SENSORS, simulate_pairs
from curvescan.simulation.pairs import ScanPair
from curvescan.types import Floats

_CHI2_95 = 7.815  # 95 % of a chi-square of three degrees of freedom


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """One kind of pair."""

    name: str  # for tables
    sensor: str  # name of a simulated sensor
    # motion, uniform within: metres, degrees
    translation_max: float
    rotation_max_deg: float
    people_share: float  # share of the beams on people who differ between the scans


def _scenario(name: str, sensor: str, size: tuple[float, float], people_share: float = 0.0) -> Scenario:
    return Scenario(
        name=name, sensor=sensor, translation_max=size[0], rotation_max_deg=size[1], people_share=people_share
    )


_SIZES = {"small": (0.1, 5.0), "medium": (0.3, 15.0), "large": (0.6, 40.0)}
_PEOPLE = 0.15

SCENARIOS = (
    *(_scenario(name, "sick-lms200", size) for name, size in _SIZES.items()),
    *(_scenario(f"{name}, people", "sick-lms200", size, _PEOPLE) for name, size in _SIZES.items()),
    _scenario("360 deg, small", "spinning-360", _SIZES["small"]),
    _scenario("360 deg, large, people", "spinning-360", _SIZES["large"], _PEOPLE),
    _scenario("270 deg, small", "hokuyo-270", _SIZES["small"]),
    _scenario("270 deg, large, people", "hokuyo-270", _SIZES["large"], _PEOPLE),
    _scenario("360 deg, any turn", "spinning-360", (0.3, 180.0)),
)


@dataclass(frozen=True, kw_only=True)
class ScenarioScore:
    """How one method did in one scenario."""

    # names
    method: str
    scenario: str
    success: float  # share of pairs matched within 0.1 m and 2 degrees
    false_positives: float  # share of pairs that are ``ok`` and not within
    # the same without those that name a degenerate direction, along which their covariance is wide
    unflagged_false_positives: float
    # median translation error of the matches, and what the Cramér-Rao bound allows, metres
    median_error: float
    bound: float
    nees: float  # mean normalised estimation error squared of right matches; 3 when the covariance is right
    inside_95: float  # share of right matches inside the 95 % ellipsoid of their covariance


def score_scenario(
    scenario: Scenario,
    methods: Sequence[str],
    *,
    n_pairs: int = 300,
    seed: int = 1,
    on_pair: Callable[[], None] | None = None,
) -> list[ScenarioScore]:
    """Return how each method does on the same pairs of one scenario, each pair in a fresh office, without a guess."""
    sensor = SENSORS[scenario.sensor]
    pairs = simulate_pairs(
        "office",
        sensor=sensor,
        n_pairs=n_pairs,
        translation_max=scenario.translation_max,
        rotation_max=np.radians(scenario.rotation_max_deg),
        people_share=scenario.people_share,
        seed=seed,
    )
    tried = _tried(pairs, methods, on_pair)
    bound = median_error([pair_bound(one.pair, sensor) for one in tried[methods[0]]])
    return [_score(method, scenario.name, tried[method], bound) for method in methods]


@dataclass(frozen=True, kw_only=True)
class OpenScore:
    """How one method did where no laser can fix the whole pose."""

    # names
    method: str
    world: str
    # share of the pairs with a pose, and of these the share that names its degenerate direction
    ok: float
    flagged: float
    # as in :class:`ScenarioScore`, over all pairs with a pose; a motion along an arc is linear to first order only, so
    # that a few large ones decide the mean
    nees: float
    nees_median: float
    inside_95: float


OPEN_WORLDS = ("bare-corridor", "round-room")
"""Simulated worlds that leave a motion open: along the corridor, around the room."""


def score_open(
    world: str, methods: Sequence[str], *, n_pairs: int = 300, seed: int = 1, on_pair: Callable[[], None] | None = None
) -> list[OpenScore]:
    """Return how each method does on small motions (0.1 m, 5 degrees) in a world that leaves one open."""
    pairs = simulate_pairs(
        world, n_pairs=n_pairs, translation_max=0.1, rotation_max=np.radians(5.0), sight_share=0.3, seed=seed
    )
    tried = _tried(pairs, methods, on_pair)
    return [_score_open(method, world, tried[method]) for method in methods]


def _tried(
    pairs: Iterable[ScanPair], methods: Sequence[str], on_pair: Callable[[], None] | None
) -> dict[str, list[_Try]]:
    """Return what each method makes of each pair."""
    tried: dict[str, list[_Try]] = {method: [] for method in methods}
    for pair in pairs:
        for method in methods:
            result = match(pair.reference, pair.current, method=method)
            tried[method].append(_Try(pair=pair, result=result))
        if on_pair:
            on_pair()
    return tried


def _score_open(method: str, world: str, tries: list[_Try]) -> OpenScore:
    matched = [one for one in tries if one.result.ok]
    nees = np.array([one.nees for one in matched])
    flagged = [one.result.degenerate_direction is not None for one in matched]
    return OpenScore(
        method=method,
        world=world,
        ok=len(matched) / len(tries),
        flagged=float(np.mean(flagged)) if matched else float("nan"),
        nees=float(nees.mean()) if matched else float("nan"),
        nees_median=float(np.median(nees)) if matched else float("nan"),
        inside_95=float(np.mean(nees < _CHI2_95)) if matched else float("nan"),
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class _Try:
    pair: ScanPair
    result: MatchResult

    @property
    def error(self) -> Floats:
        """(3,) pose found minus true pose; NaN without a pose."""
        difference = self.result.pose - self.pair.pose
        return np.array([difference[0], difference[1], float(se2.wrap(difference[2]))])

    @property
    def nees(self) -> float:
        return float(self.error @ np.linalg.solve(self.result.covariance, self.error))

    @property
    def is_right(self) -> bool:
        x, y, theta = self.error
        return bool(self.result.ok and np.hypot(x, y) < SUCCESS[0] and abs(theta) < SUCCESS[1])


def _score(method: str, scenario: str, tries: list[_Try], bound: float) -> ScenarioScore:
    right = [one for one in tries if one.is_right]
    matched = [one for one in tries if one.result.ok]
    nees = np.array([one.nees for one in right])
    distance = [np.hypot(*one.error[:2]) for one in matched]
    return ScenarioScore(
        method=method,
        scenario=scenario,
        success=len(right) / len(tries),
        false_positives=(len(matched) - len(right)) / len(tries),
        unflagged_false_positives=sum(one.result.degenerate_direction is None and not one.is_right for one in matched)
        / len(tries),
        median_error=float(np.median(distance)) if distance else float("nan"),
        bound=bound,
        nees=float(nees.mean()) if nees.size else float("nan"),
        inside_95=float(np.mean(nees < _CHI2_95)) if nees.size else float("nan"),
    )
