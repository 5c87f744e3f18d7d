"""All that the matcher knows of one scan, computed once and used whether it is the current scan or the reference."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from curvescan._jit import kernel
from curvescan.matchers.curvescan.config import CurvescanConfig
from curvescan.matchers.curvescan.features.keypoints import find_corners, with_ends
from curvescan.matchers.curvescan.features.objects import Objects, find_objects
from curvescan.matchers.curvescan.features.range_image import RangeImage, azimuth_table, bearing, uneven_azimuth_table
from curvescan.matchers.curvescan.features.sampling import choose_samples
from curvescan.matchers.curvescan.features.segments import Sweep, ordered_readings
from curvescan.matchers.curvescan.features.surfels import LENGTH, NX, NY, fit_lines, fit_surfels
from curvescan.scan import LaserScan
from curvescan.types import Bools, Floats, Ints

N_WIDE = 192  # readings of each scan where poses that are nearly as good as each other are compared
_NOISY = 0.02  # range noise, metres, from which on segments and lines are found anew with it
# Growth of `jump` for each metre of range noise above that; power of the noise with which `arm` grows: from two thirds
# on the directions of lines are known as well as with less noise.
_JUMP_GROWTH, _ARM_GROWTH = 8.0, 0.9

# Bins of the histogram: of 3 degrees, which smoothing and a parabola through the best shift make finer.
N_DIRECTIONS = 120
_LEAST_NORM2 = 1e-12  # square metres, so that a scan without surfaces is not divided by zero


class CurvescanFeatures(NamedTuple):
    """Surfels, keypoints and the range image of one scan."""

    n_beams: int  # beams of the scan
    beam_idx: Ints  # (m,): the scan's own index of each valid reading, readings counter-clockwise from a breakpoint on
    bounds: Ints  # (s + 1,): surface k is readings bounds[k]:bounds[k + 1]
    objects: Objects  # surfaces that may move as one
    image: RangeImage  # the readings and the lines through them, and which reading stands in which direction
    keypoints: Floats  # (k, 5): corners and ends of surfaces; columns as in keypoints.py
    directions: Floats  # (120,): length of surface that faces each direction

    @property
    def wide_image(self) -> RangeImage:
        """The image with more samples, to compare poses that are nearly as good as each other."""
        return self.image._replace(samples=choose_samples(self.image.surfels, N_WIDE))

    @property
    def full_image(self) -> RangeImage:
        """The image with all readings as samples."""
        return self.image._replace(samples=self.image.surfels)


def extract_features(scan: LaserScan, config: CurvescanConfig) -> CurvescanFeatures:
    """Return the features of a scan, also of one without a valid reading."""
    n, step = len(scan), abs(scan.angle_increment)
    is_clockwise, is_closed, is_even = scan.angle_increment < 0.0, scan.is_full_circle, scan.has_uniform_angles
    segments, keypoints = config.segments, config.keypoints
    angles = scan.angles[:0] if is_even else scan.angles
    n_slots = 0 if not is_even else max(round(2.0 * math.pi / step), 1) if is_closed else n + 1
    beam_idx, bounds, surfels, corners, few, label, is_free, is_small, directions, table = extract(
        Sweep(scan.ranges, scan.directions, scan.valid, angles, step, is_clockwise, is_closed),
        (segments.incidence_limit, segments.jump, segments.arm, segments.range_sigma_min),
        keypoints.arm_lengths,
        keypoints.min_turn,
        (keypoints.max_keypoints, config.scoring.n_samples, n_slots),
    )
    if is_even:
        angle_min = scan.angle_min + (scan.angle_increment * (n - 1) if is_clockwise else 0.0)
        density = 1.0 / step
    else:
        angle_min = float(scan.angles[-1 if is_clockwise else 0])
        table, density = uneven_azimuth_table(beam_idx, scan.angles, step, is_closed)
    azimuth = np.array([math.remainder(angle_min, 2.0 * math.pi), density, density * step])
    return CurvescanFeatures(
        n_beams=n,
        beam_idx=beam_idx,
        bounds=bounds,
        objects=Objects(label, is_free, is_small),
        image=RangeImage(few, surfels, azimuth, table),
        keypoints=corners,
        directions=directions,
    )


@kernel
def extract(
    sweep: Sweep,
    lengths: tuple[float, float, float, float],
    arms: Floats,
    min_turn: float,
    counts: tuple[int, int, int],
) -> tuple[Ints, Ints, Floats, Floats, Floats, Ints, Bools, Bools, Floats, Ints]:
    """Return beams, bounds, surfels, keypoints, samples, objects, directions and azimuths.

    What is noise and what a jump from one surface to the next, and over which length a line's direction is known well,
    depends on the noise, which is estimated from the lines: where it is large, segments and lines are found anew with
    it. lengths: incidence limit, jump, arm and least noise; counts: keypoints at most, samples, slots of the azimuth
    table.
    """
    incidence_limit, jump, arm, sigma_min = lengths
    max_keypoints, n_samples, n_slots = counts
    beam_idx, readings, bounds = ordered_readings(sweep, incidence_limit, jump)
    fits, sums, sigma = fit_lines(readings, bounds, arm, sigma_min)
    if sigma > _NOISY:
        jump += _JUMP_GROWTH * (sigma - _NOISY)
        arm *= (sigma / _NOISY) ** _ARM_GROWTH
        beam_idx, readings, bounds = ordered_readings(sweep, incidence_limit, jump)
        fits, sums, sigma = fit_lines(readings, bounds, arm, sigma_min)
    surfels = fit_surfels(readings, fits, sweep.step, sigma)
    # of the readings, whose rows are short and stay in the cache, and not of the surfels
    corners = find_corners(readings, sums, bounds, arms, sigma, min_turn, max_keypoints)
    keypoints = with_ends(corners, readings, sums, bounds, arms[arms.size // 2], sweep.is_closed, max_keypoints)
    samples = choose_samples(surfels, n_samples)
    table = azimuth_table(beam_idx, sweep.ranges.size, n_slots, sweep.is_clockwise, sweep.is_closed)
    label, is_free, is_small = find_objects(surfels, bounds)
    directions = direction_histogram(surfels)
    return beam_idx, bounds, surfels, keypoints, samples, label, is_free, is_small, directions, table


@kernel
def direction_histogram(surfels: Floats) -> Floats:
    """Return (120,) the length of surface that faces each direction, smoothed, of unit norm; it turns with the sensor.

    As in Weiss and von Puttkamer, 1995.
    """
    counts = np.zeros(N_DIRECTIONS)
    places = np.empty(surfels.shape[0])
    for i in range(places.size):  # in a loop of its own, which the compiler turns into vector instructions
        places[i] = (bearing(surfels[i, NX], surfels[i, NY]) + math.pi) * float(N_DIRECTIONS) / (2.0 * math.pi)
    for i in range(places.size):
        k = min(int(places[i]), N_DIRECTIONS - 1)
        share = places[i] - k
        counts[k] += (1.0 - share) * surfels[i, LENGTH]
        counts[k + 1 if k < N_DIRECTIONS - 1 else 0] += share * surfels[i, LENGTH]
    smooth = np.empty(N_DIRECTIONS)
    total = _LEAST_NORM2
    for k in range(N_DIRECTIONS):
        smooth[k] = counts[k - 1] + 2.0 * counts[k] + counts[(k + 1) % N_DIRECTIONS]
        total += smooth[k] * smooth[k]
    return smooth / math.sqrt(total)
