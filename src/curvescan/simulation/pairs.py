"""simulate_pairs(): scan pairs with a known relative pose, for benchmarks of matchers."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import overload

import numpy as np
from numpy.typing import ArrayLike

from curvescan import se2
from curvescan.errors import InvalidArgumentError, require
from curvescan.scan import LaserScan
from curvescan.simulation.buildings.catalogue import build_world
from curvescan.simulation.buildings.world import World
from curvescan.simulation.recording import as_scan, observe
from curvescan.simulation.sensing.people import PAIR, PATH, PEOPLE, WORLD, People, child, crowd
from curvescan.simulation.sensing.sensors import Sensor, choose_sensor
from curvescan.types import Bools, Floats, Pose

_ATTEMPTS = 400  # places tried for one pair


@dataclass(frozen=True, eq=False, kw_only=True)
class ScanPair:
    """Two scans of one world and the truth about them."""

    # the earlier and the later scan
    reference: LaserScan
    current: LaserScan
    pose: Pose  # (3,): true pose of `current` in `reference`: [x, y, theta], metres, metres, radians in (-pi, pi]
    # (n_beams,): which valid readings are of people
    is_person_ref: Bools
    is_person_cur: Bools
    reference_pose: Pose  # (3,): true pose of `reference` in the world
    world: World  # where it was

    def __repr__(self) -> str:
        x, y, theta = self.pose
        return f"ScanPair(x={x:.4f} m, y={y:.4f} m, theta={theta:.4f} rad in {self.world.name})"


@dataclass(frozen=True, eq=False, kw_only=True)
class ScanPairs(Sequence[ScanPair]):
    """A sequence of scan pairs, each made on access, from its own seed."""

    world: World | str  # where all pairs are; a name: built anew for each pair
    sensor: Sensor  # what measures
    motions: Pose  # (n, 3): the pose of each current scan in its reference scan
    people_share: float  # share of the beams that people block
    seed: int
    people: People = People()  # noqa: RUF009 - frozen; what they look like
    clearance: float = 0.4  # least distance of both places to anything, metres
    sight_share: float = 0.6  # least share of the beams that meet the world within range at both places

    def __post_init__(self) -> None:
        require(0.0 <= self.people_share <= 0.9, "people_share must lie in [0, 0.9]", self.people_share)
        require(self.clearance >= 0.0, "clearance must be >= 0", self.clearance)
        require(0.0 <= self.sight_share <= 1.0, "sight_share must lie in [0, 1]", self.sight_share)

    def __len__(self) -> int:
        return len(self.motions)

    @overload
    def __getitem__(self, i: int) -> ScanPair: ...
    @overload
    def __getitem__(self, i: slice) -> Sequence[ScanPair]: ...
    def __getitem__(self, i: int | slice) -> ScanPair | Sequence[ScanPair]:
        if isinstance(i, slice):
            return [self._pair(k) for k in range(len(self))[i]]
        if not -len(self) <= i < len(self):
            raise IndexError(f"pair {i} of {len(self)}")
        return self._pair(i % len(self))

    def _pair(self, i: int) -> ScanPair:
        seed = child(self.seed, PAIR, i)
        world = self.world
        if isinstance(world, str):
            world = build_world(world, child(seed, WORLD))
        poses = self._places(world, self.motions[i], np.random.default_rng(child(seed, PATH)))
        rng = np.random.default_rng(child(seed, PEOPLE))
        circles = [crowd(world, pose, self.sensor, self.people_share, self.people, rng) for pose in poses]
        n_circles = max(len(one) for one in circles)
        # filled up with tiny ones that are far out of sight
        padded = np.array([np.vstack([c, np.tile([1e6, 1e6, 1e-3], (n_circles - len(c), 1))]) for c in circles])
        ranges, _, is_person = observe(world, poses, self.sensor, padded, seed)
        return ScanPair(
            reference=as_scan(ranges[0], self.sensor, 0.0),
            current=as_scan(ranges[1], self.sensor, self.sensor.period),
            pose=se2.between(poses[0], poses[1]),
            is_person_ref=is_person[0],
            is_person_cur=is_person[1],
            reference_pose=poses[0],
            world=world,
        )

    def _places(self, world: World, motion: Pose, rng: np.random.Generator) -> Pose:
        """Return the (2, 3) poses of a pair: free, and with enough of the world in sight."""
        for _ in range(_ATTEMPTS // 20):
            xy = rng.uniform(world.bounds[:2], world.bounds[2:], (20, 2))
            ref = np.column_stack([xy, rng.uniform(-np.pi, np.pi, 20)])
            cur = se2.compose(ref, motion)
            is_free = world.is_free(xy, self.clearance) & world.is_free(cur[:, :2], self.clearance)
            for k in np.flatnonzero(is_free):
                poses = np.array([ref[k], cur[k]])
                _, exact, _ = observe(world, poses, self.sensor, np.empty((2, 0, 3)), 0)
                if np.all(np.mean(exact <= self.sensor.range_max, axis=1) >= self.sight_share):
                    return poses
        raise InvalidArgumentError(
            f"no place in {world.name!r} is {self.clearance} m clear of everything, before and after a move "
            f"of {np.round(motion, 3).tolist()}, and sees something with {self.sight_share:.0%} of the beams"
        )


def simulate_pairs(
    world: World | str = "office",
    *,
    sensor: Sensor | str = "sick-lms200",
    n_pairs: int = 100,
    translation_max: float = 0.3,
    rotation_max: float = np.radians(15.0),
    motions: ArrayLike | None = None,
    people_share: float = 0.0,
    seed: int = 0,
) -> ScanPairs:
    """Return scan pairs at random places with random, known motions between the two scans.

    The result keeps further settings as fields: ``dataclasses.replace(pairs, clearance=0.2)``, `sight_share`, `people`.

    Parameters
    ----------
    world : World or str
        A world, or the name of one in :data:`curvescan.simulation.WORLDS`, which is built anew for each pair.
    sensor : Sensor or str
        A sensor, or the name of one in :data:`curvescan.simulation.SENSORS`.
    n_pairs : int
        How many pairs, >= 1; ignored with `motions`. Pair i is the same whatever n_pairs is.
    translation_max, rotation_max : float
        The translation is uniform in the disc of this radius, metres; the rotation uniform in plus or minus
        this angle, radians.
    motions : (n_pairs, 3) array_like or None
        In place of random motions: the pose of each current scan in its reference scan.
    people_share : float
        Share of the beams that people block, in [0, 0.9]. Each of the two scans has people of its own.
    seed : int
        The same seed, the same bits; >= 0.

    Raises
    ------
    InvalidArgumentError
        When a name is unknown or a number out of range; on access to a pair, when no place for it is found.
    """
    if motions is None:
        require(n_pairs >= 1, "n_pairs must be >= 1", n_pairs)
        for size in (translation_max, rotation_max):
            require(0.0 <= size < np.inf, "translation_max and rotation_max must be >= 0 and finite", size)
        motions = [_motion(translation_max, rotation_max, child(seed, PAIR, i)) for i in range(n_pairs)]
    motions = np.array(motions, dtype=np.float64)
    if motions.ndim != 2 or motions.shape[1] != 3 or not np.isfinite(motions).all():
        raise InvalidArgumentError(f"motions must be finite, of shape (n_pairs, 3), got shape {motions.shape}")
    build_world(world, child(seed, WORLD))  # refuses a wrong name at once
    return ScanPairs(world=world, sensor=choose_sensor(sensor), motions=motions, people_share=people_share, seed=seed)


def _motion(translation_max: float, rotation_max: float, seed: np.random.SeedSequence) -> Floats:
    share, turn, along = np.random.default_rng(seed).random(3)
    radius, bearing = translation_max * np.sqrt(share), 2.0 * np.pi * turn
    return np.array([radius * np.cos(bearing), radius * np.sin(bearing), rotation_max * (2.0 * along - 1.0)])
