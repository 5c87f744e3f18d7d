"""All that the matcher knows of one scan, computed once and used whether it is the current scan or the reference."""

from __future__ import annotations

import math
from functools import cached_property
from typing import NamedTuple

from curvescan._jit import kernel
from curvescan.matchers.curvescan.config import CurvescanConfig
from curvescan.matchers.curvescan.features.landmarks import Landmarks, find_landmarks
from curvescan.matchers.curvescan.features.objects import Objects, find_objects
from curvescan.matchers.curvescan.features.range_image import RangeImage, azimuth_table, choose_samples
from curvescan.matchers.curvescan.features.segments import Sweep, ordered_readings
from curvescan.matchers.curvescan.features.surfels import NX, NY, RANGE, X, Y, fit_lines, fit_surfels
from curvescan.scan import LaserScan
from curvescan.types import Floats, Ints

N_WIDE = 192  # readings of each scan where poses that are nearly as good as each other are compared
_NOISY = 0.02  # range noise, metres, from which on segments and lines are found anew with it
# Growth of `jump` for each metre of range noise above that; power of the noise with which `arm` grows: from two thirds
# on the directions of lines are known as well as with less noise.
_JUMP_GROWTH, _ARM_GROWTH = 8.0, 0.9


class Surfaces(NamedTuple):
    """Surfels and the range image of one scan."""

    n_beams: int  # beams of the scan
    beam_idx: Ints  # (m,): the scan's own index of each valid reading, readings counter-clockwise from a breakpoint on
    bounds: Ints  # (s + 1,): surface k is readings bounds[k]:bounds[k + 1]
    objects: Objects  # surfaces that may move as one
    stamp: float  # when it was taken, seconds
    image: RangeImage  # the readings and the lines through them, and which reading stands in which direction


class CurvescanFeatures(Surfaces):
    """What the matcher knows of one scan; its landmarks from when they are first asked for."""

    is_closed: bool  # whether the last beam neighbours the first

    @property
    def wide_image(self) -> RangeImage:
        """The image with more samples, to compare poses that are nearly as good as each other."""
        return self.image._replace(samples=choose_samples(self.image.surfels, N_WIDE))

    @property
    def full_image(self) -> RangeImage:
        """The image with all readings as samples."""
        return self.image._replace(samples=self.image.surfels)

    @property
    def sampled_points(self) -> Floats:
        """(k, 4) the samples alone: places, metres, and unit normals."""
        return self.image.samples[:, [X, Y, NX, NY]]

    @cached_property
    def landmarks(self) -> Landmarks:
        """Walls, edges, directions and axis: a match near a good prior needs none of them."""
        return find_landmarks(self.image.surfels, self.image.samples, self.bounds, self.is_closed)


def extract_features(scan: LaserScan, config: CurvescanConfig) -> CurvescanFeatures:
    """Return the features of a scan, also of one without a valid reading."""
    step, segments, is_closed = scan.angle_increment, config.segments, scan.is_full_circle
    is_even, beams, growth = scan.has_uniform_angles, (scan.directions, scan.angles), scan.noise_doubled_at**-2.0
    features = CurvescanFeatures._make(
        extract(
            Sweep(scan.ranges, scan.valid_range, *beams, abs(step), is_even, step < 0.0, is_closed, growth),
            (segments.incidence_limit, segments.jump, segments.arm, segments.range_sigma_min),
            config.scoring.n_samples,
            scan.stamp,
        )
    )
    features.is_closed = is_closed
    return features


@kernel
def extract(sweep: Sweep, lengths: tuple[float, float, float, float], n_samples: int, stamp: float) -> Surfaces:
    """Return the surfels and the range image of a scan.

    What is noise and what a jump from one surface to the next, and over which length a line's direction is known well,
    depends on the noise, which is estimated from the lines: where it is large, segments and lines are found anew with
    it. lengths: incidence limit, jump, arm and least noise.
    """
    incidence_limit, jump, arm, sigma_min = lengths
    beam_idx, readings, bounds = ordered_readings(sweep, incidence_limit, jump)
    fits, sigma = fit_lines(readings, bounds, arm, sweep.growth)
    mean_range = readings[:, RANGE].sum() / max(readings.shape[0], 1)
    noise = sigma * math.sqrt(1.0 + sweep.growth * mean_range**2)
    if noise > _NOISY:
        jump += _JUMP_GROWTH * (noise - _NOISY)
        arm *= (noise / _NOISY) ** _ARM_GROWTH
        beam_idx, readings, bounds = ordered_readings(sweep, incidence_limit, jump)
        fits, sigma = fit_lines(readings, bounds, arm, sweep.growth)
    surfels = fit_surfels(readings, fits, sweep.step, (sigma, sweep.growth, sigma_min))
    angles, step, is_clockwise = sweep.angles, sweep.step, sweep.is_clockwise
    table, density = azimuth_table(beam_idx, angles, step, sweep.is_even, is_clockwise, sweep.is_closed)
    first = angles[angles.size - 1 if is_clockwise else 0] if angles.size > 0 else 0.0
    first -= 2.0 * math.pi * round(first / (2.0 * math.pi))
    image = RangeImage(choose_samples(surfels, n_samples), surfels, table, first, density, density * step)
    return Surfaces(angles.size, beam_idx, bounds, find_objects(surfels, bounds), stamp, image)
