"""Probes: spread over the lengths of the surfaces, in any number."""

from __future__ import annotations

import numpy as np

from curvescan.matchers.curvescan.features.range_image import choose_samples
from tests.matchers.curvescan.scenes import features, pillar_scan


def test_probes_are_spread_over_the_lengths_of_the_surfaces():
    one = features(pillar_scan(sigma=0.0))
    surfels = one.image.surfels
    step = 1.0 / one.image.azimuth[1]
    samples = choose_samples(surfels, 200)
    assert samples.shape == (200, 11)
    facing = np.abs(np.sum(surfels[:, :2] * surfels[:, 5:7], axis=1)) / surfels[:, 2]
    length = np.clip(surfels[:, 2] * step / np.maximum(facing, 0.1), 0.03, 0.3)
    is_right = surfels[:, 1] < 0
    share = length[is_right].sum() / length.sum()
    assert abs(np.mean(samples[:, 1] < 0) - share) < 0.02
    # each is a surfel of the scan
    distance = np.abs(samples[:, None, :2] - surfels[None, :, :2]).sum(axis=2).min(axis=1)
    assert distance.max() == 0.0


def test_the_first_probes_are_spread_like_all():
    samples = features(pillar_scan(sigma=0.0)).image.samples
    bearing = np.arctan2(samples[:, 1], samples[:, 0])
    for n in (6, 12, 24):
        edges = np.quantile(bearing, [1 / 3, 2 / 3])
        thirds = np.bincount(np.digitize(bearing[:n], edges), minlength=3)
        assert thirds.min() >= n // 6


def test_surfaces_without_lines_have_no_probes():
    surfels = np.zeros((5, 11))
    surfels[:, 2], surfels[:, 7] = 1.0, -1.0
    for one in (surfels, surfels[:0]):
        assert choose_samples(one, 12).shape == (0, 11)
