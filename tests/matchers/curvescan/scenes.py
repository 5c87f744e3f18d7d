"""Scans and their features for the tests of the default matcher's stages."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

import curvescan as cs
from curvescan.matchers.curvescan.assessment.confidence import ScoredPoses
from curvescan.matchers.curvescan.assessment.evidence import N_EVIDENCE, add_evidence, gather_evidence
from curvescan.matchers.curvescan.association import FORWARD, motion_of
from curvescan.matchers.curvescan.config import CurvescanConfig
from curvescan.matchers.curvescan.features.features import extract_features
from curvescan.matchers.curvescan.features.objects import Objects
from curvescan.matchers.curvescan.prior import log_odds
from tests.scenes import room_ranges, room_scan

MOTION = np.array([0.12, -0.07, 0.09])


def features(scan, config=None):
    return extract_features(scan, config or CurvescanConfig())


def pillar_scan(pose=(0.0, 0.0, 0.0), *, sigma=0.005, seed=0, n_beams=361, fov=math.pi, **kwargs):
    """The room of scenes.py with three square pillars, so that no half of it looks like the other."""
    increment = fov / (n_beams - 1)
    angles = -fov / 2 + increment * np.arange(n_beams)
    ranges = room_ranges(pose, angles)
    for x, y, side in ((1.2, 0.7, 0.3), (1.6, -0.8, 0.2), (-1.0, 1.2, 0.4)):
        box = np.array([x, y, x + side, y + side])
        c, s = np.cos(angles + pose[2]), np.sin(angles + pose[2])
        with np.errstate(divide="ignore", invalid="ignore"):
            across = np.sort([(box[0] - pose[0]) / c, (box[2] - pose[0]) / c], axis=0)
            along = np.sort([(box[1] - pose[1]) / s, (box[3] - pose[1]) / s], axis=0)
        enter, leave = np.maximum(across[0], along[0]), np.minimum(across[1], along[1])
        ranges = np.where((enter < leave) & (enter > 0), np.minimum(ranges, enter), ranges)
    noise = sigma * np.random.default_rng(seed).standard_normal(n_beams)
    return cs.LaserScan(ranges + noise, angle_min=-fov / 2, angle_increment=increment, range_max=20.0, **kwargs)


def hall_scan(x, *, sigma=0.005, seed=0, width=2.0):
    """A half circle in a corridor along x, endless both ways, seen from its middle."""
    angles = np.linspace(-math.pi / 2, math.pi / 2, 361)
    with np.errstate(divide="ignore"):
        ranges = 0.5 * width / np.abs(np.sin(angles))
    noise = sigma * np.random.default_rng(seed).standard_normal(361)
    return cs.LaserScan(ranges + noise, angle_min=-math.pi / 2, angle_increment=math.pi / 360, range_max=8.0)


def turned(scan, angle):
    """The scan of a sensor whose frame is turned against that of its beams by an angle more, radians."""
    return replace(scan, angle_min=scan.angle_min + angle, angles=None)


def pair(seed=0, motion=MOTION, **kwargs):
    """Features of two scans of the room with pillars, `motion` apart."""
    return (features(pillar_scan(seed=2 * seed, **kwargs)), features(pillar_scan(motion, seed=2 * seed + 1, **kwargs)))


def weigh(ref, cur, prior, poses, scores):
    """What speaks for poses as they are, the best first."""
    evidence, _ = gather_evidence(ref, cur, poses, CurvescanConfig().scoring.margin)
    return ScoredPoses(poses, np.array(scores), evidence, *log_odds(poses, prior)).best_first()


def no_objects(n):
    """All contour of n readings taken for walls."""
    none = np.full(n, -1)
    return Objects(none, none, np.zeros(0, dtype=bool), np.zeros(n, dtype=bool))


def compare_readings(surfels, other, pose, margin):
    """What the readings of a scan are to another one, and their partners there; pose: of the scan in the other."""
    n = len(surfels)
    one = other._replace(
        beam_idx=np.arange(n),
        bounds=np.array([0, n]),
        objects=no_objects(n),
        image=other.image._replace(samples=surfels, surfels=surfels),
    )
    codes, partner = np.empty(n, dtype=np.uint8), np.empty(n, dtype=np.int64)
    add_evidence(one, other, motion_of(pose, FORWARD), margin, np.zeros(N_EVIDENCE), codes, partner)
    return codes, partner


__all__ = [
    "MOTION",
    "compare_readings",
    "features",
    "no_objects",
    "pair",
    "pillar_scan",
    "room_scan",
    "turned",
    "weigh",
]
