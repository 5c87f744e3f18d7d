"""All that the matcher knows of one scan, computed once and used whether it is the current scan or the reference."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from curvescan.consensus.config import ConsensusConfig
from curvescan.consensus.keypoints import find_ends, find_keypoints
from curvescan.consensus.polar import polar_lookup
from curvescan.consensus.surfaces import fit_surfels, moments, sweep
from curvescan.consensus.probes import choose_probes
from curvescan.consensus.turns import direction_histogram
from curvescan.scan import LaserScan
from curvescan.types import Floats, Ints


@dataclass(frozen=True, eq=False, kw_only=True)
class ConsensusFeatures:
    """Surfels, characteristic points and the polar frame of one scan.

    Attributes
    ----------
    n_beams : int
        Beams of the scan.
    beam_idx : (m,) int64
        The scan's own index of each valid reading, readings counter-clockwise from a breakpoint on.
    surfels : (m, 9) float64
        The readings and the lines through them; columns as in surfaces.py; sensor frame, metres.
    bounds : (s + 1,) int64
        Surface k is surfels[bounds[k]:bounds[k + 1]].
    lookup : (n_slots,) int64
        Reading in each direction once around the circle, as in polar.py.
    fan : (3,) float64
        Direction of slot 0 of the lookup, radians in (-pi, pi], slots a radian, range noise, metres.
    keypoints : (k, 5) float64
        Frames; columns as in keypoints.py.
    probes : (p, 9) float64
        Surfels that stand for all of them when a hypothesis is tried.
    directions : (120,) float64
        Length of surface that faces each direction.
    """

    n_beams: int
    beam_idx: Ints
    surfels: Floats
    bounds: Ints
    lookup: Ints
    fan: Floats
    keypoints: Floats
    probes: Floats
    directions: Floats

    @property
    def sigma(self) -> float:
        """Range noise of the scan, metres."""
        return float(self.fan[2])


def extract_features(scan: LaserScan, config: ConsensusConfig) -> ConsensusFeatures:
    """Return the features of a scan, also of one without a valid reading."""
    n = len(scan)
    step = abs(scan.angle_increment)
    is_clockwise, is_closed = scan.angle_increment < 0.0, scan.is_full_circle
    angle_min = scan.angle_min + (scan.angle_increment * (n - 1) if is_clockwise else 0.0)
    n_slots = max(round(2.0 * math.pi / step), n if not is_closed else 1)
    beam_idx, surfels, bounds = sweep(
        scan.ranges,
        scan.directions,
        scan.valid,
        is_clockwise,
        is_closed,
        step,
        config.surface.incidence_limit,
        config.surface.max_gap,
    )
    sums = moments(surfels)
    sigma = fit_surfels(surfels, sums, bounds, config.surface.arm, config.surface.range_sigma_min)
    corners = find_keypoints(surfels, sums, bounds, np.array([0.12, 0.25, 0.5]), sigma, 0.4, 96)
    ends = find_ends(surfels, sums, bounds, 0.25, is_closed, 64)
    return ConsensusFeatures(
        n_beams=n,
        beam_idx=beam_idx,
        surfels=surfels,
        bounds=bounds,
        lookup=polar_lookup(beam_idx, n, n_slots, is_clockwise),
        fan=np.array([math.remainder(angle_min, 2.0 * math.pi), 1.0 / step, sigma]),
        keypoints=np.concatenate((corners, ends)),
        probes=choose_probes(surfels, step, 48),
        directions=direction_histogram(surfels, step),
    )
