"""All that the matcher knows of one scan, computed once and used whether it is the current scan or the reference."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from curvescan.matchers.curvescan.config import CurvescanConfig, SegmentsConfig
from curvescan.matchers.curvescan.features.direction_histogram import direction_histogram
from curvescan.matchers.curvescan.features.keypoints import find_corners, with_ends
from curvescan.matchers.curvescan.features.objects import Objects, find_objects
from curvescan.matchers.curvescan.features.range_image import SIGMA, RangeImage, azimuth_table, uneven_azimuth_table
from curvescan.matchers.curvescan.features.sampling import choose_samples
from curvescan.matchers.curvescan.features.segments import MAX_GAP, ordered_readings
from curvescan.matchers.curvescan.features.surfels import fit_lines, fit_surfels
from curvescan.scan import LaserScan
from curvescan.types import Floats, Ints

_N_WIDE = 192
"""Readings of each scan where poses that are nearly as good as each other are compared."""

_NOISY = 0.02
"""Range noise, metres, from which on segments and lines are found anew with it."""

_JUMP_GROWTH, _ARM_GROWTH = 8.0, 0.9
"""Growth of `jump` for each metre of range noise above that; power of the noise with which `arm` grows: from two thirds
on the directions of lines are known as well as with less noise."""


class CurvescanFeatures(NamedTuple):
    """Surfels, keypoints and the range image of one scan."""

    n_beams: int  # beams of the scan
    beam_idx: Ints  # (m,): the scan's own index of each valid reading, readings counter-clockwise from a breakpoint on
    bounds: Ints  # (s + 1,): surface k is readings bounds[k]:bounds[k + 1]
    objects: Objects  # surfaces that may move as one
    image: RangeImage  # the readings and the lines through them, and which reading stands in which direction
    wide_image: RangeImage  # the same with more samples, to compare poses that are nearly as good as each other
    full_image: RangeImage  # the same with all readings as samples
    keypoints: Floats  # (k, 5): corners and ends of surfaces; columns as in keypoints.py
    directions: Floats  # (120,): length of surface that faces each direction

    @property
    def sigma(self) -> float:
        """Range noise of the scan, metres."""
        return float(self.image.azimuth[SIGMA])

    @property
    def points(self) -> Floats:
        """(m, 2) readings, metres, sensor frame."""
        return self.image.surfels[:, :2]


def extract_features(scan: LaserScan, config: CurvescanConfig) -> CurvescanFeatures:
    """Return the features of a scan, also of one without a valid reading."""
    n, step = len(scan), abs(scan.angle_increment)
    is_clockwise, is_closed = scan.angle_increment < 0.0, scan.is_full_circle
    is_even = scan.has_uniform_angles
    keypoints = config.keypoints
    end_arm = keypoints.arms[len(keypoints.arms) // 2]
    beam_idx, bounds, surfels, sums, sigma = _lines(scan, config.segments)
    corners = find_corners(
        surfels, sums, bounds, keypoints.arm_lengths, sigma, keypoints.min_turn, keypoints.max_keypoints
    )
    corners_and_ends = with_ends(corners, surfels, sums, bounds, end_arm, is_closed, keypoints.max_keypoints)
    if is_even:
        angle_min = scan.angle_min + (scan.angle_increment * (n - 1) if is_clockwise else 0.0)
        n_slots = max(round(2.0 * math.pi / step), 1) if is_closed else n + 1
        table, density = azimuth_table(beam_idx, n, n_slots, is_clockwise, is_closed), 1.0 / step
    else:
        angle_min = float(scan.angles[-1 if is_clockwise else 0])
        table, density = uneven_azimuth_table(beam_idx, scan.angles, step, is_closed)
    azimuth = np.array([math.remainder(angle_min, 2.0 * math.pi), density, sigma, density * step])
    few = choose_samples(surfels, config.scoring.n_samples)
    more = choose_samples(surfels, _N_WIDE)
    return CurvescanFeatures(
        n_beams=n,
        beam_idx=beam_idx,
        bounds=bounds,
        objects=Objects(*find_objects(surfels, bounds)),
        image=RangeImage(few, surfels, azimuth, table),
        wide_image=RangeImage(more, surfels, azimuth, table),
        full_image=RangeImage(surfels, surfels, azimuth, table),
        keypoints=corners_and_ends,
        directions=direction_histogram(surfels),
    )


def _lines(scan: LaserScan, config: SegmentsConfig) -> tuple[Ints, Ints, Floats, Floats, float]:
    """Return the beams, segments, surfels, moments and range noise of a scan.

    What is noise and what a jump from one surface to the next, and over which length a line's direction is known well,
    depends on the noise, which is estimated from the lines: where it is large, segments and lines are found anew with
    it.
    """
    jump, arm, step = config.jump, config.arm, abs(scan.angle_increment)
    is_clockwise, is_closed = scan.angle_increment < 0.0, scan.is_full_circle
    angles = scan.angles[:0] if scan.has_uniform_angles else scan.angles
    ranges, directions, valid = scan.ranges, scan.directions, scan.valid
    limits = config.incidence_limit, MAX_GAP
    for is_last in (False, True):
        beam_idx, readings, bounds = ordered_readings(
            ranges, directions, valid, is_clockwise, is_closed, step, angles, *limits, jump
        )
        fits, sums, sigma = fit_lines(readings, bounds, arm, config.range_sigma_min)
        if is_last or sigma <= _NOISY:
            break
        jump += _JUMP_GROWTH * (sigma - _NOISY)
        arm *= (sigma / _NOISY) ** _ARM_GROWTH
    return beam_idx, bounds, fit_surfels(readings, fits, step, sigma), sums, sigma
