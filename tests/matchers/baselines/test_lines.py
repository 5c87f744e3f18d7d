"""Split-and-merge against its recursive text, and lines of a room that are known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from curvescan.matchers.baselines.config import LinesConfig
from curvescan.matchers.baselines.lines import _split_and_merge, extract_lines, nearest_lines
from curvescan.matchers.baselines.points import sweep_of
from tests.reference import baselines as twin
from tests.scenes import ROOM, room_scan, rough_polyline

EVERY = LinesConfig(min_readings=3, min_length=1e-6)


@given(st.integers(0, 10_000), st.floats(0.005, 0.2))
@settings(max_examples=40)
def test_stretches_agree_with_the_slow_twin(seed, max_error):
    points = np.vstack([rough_polyline(seed), 10.0 + rough_polyline(seed + 1, n=25)])
    surfaces = [(0, 40), (40, 65)]
    starts, stops = _split_and_merge(points, np.array([0, 40]), np.array([40, 65]), max_error)
    expected = twin.split_and_merge(points, surfaces, max_error)
    assert list(zip(starts.tolist(), stops.tolist(), strict=True)) == expected


def test_stretches_cover_every_reading_once():
    points = rough_polyline(5, n=200, n_corners=8)
    starts, stops = _split_and_merge(points, np.array([0]), np.array([200]), 0.03)
    assert starts[0] == 0
    assert stops[-1] == 200
    np.testing.assert_array_equal(starts[1:], stops[:-1])


def test_a_room_has_the_walls_it_has():
    points = sweep_of(room_scan(sigma=0.005, seed=1))
    lines = extract_lines(points, LinesConfig())
    assert len(lines) == 3  # of four, in front of a sensor that sees half a circle
    _, y_min, x_max, y_max = ROOM
    offsets = np.sum(lines.normals * lines.centres, axis=1)
    np.testing.assert_allclose(np.sort(-offsets), np.sort([x_max, -y_min, y_max]), atol=0.005)
    assert (offsets < 0).all()  # normals look at the sensor
    readings = lines.readings(points, np.arange(3))
    assert np.unique(readings).size == readings.size > 350


def test_lines_are_total_least_squares_fits():
    points = sweep_of(room_scan(sigma=0.01, seed=3))
    lines = extract_lines(points, EVERY)
    assert len(lines) >= 3
    for k in range(len(lines)):
        readings = points.points[lines.readings(points, np.array([k]))]
        centre, direction, _ = twin.fit(readings)
        np.testing.assert_allclose(lines.centres[k], centre, atol=1e-9)
        assert abs(abs(lines.directions[k] @ direction) - 1.0) < 1e-12
        along = (readings - centre) @ lines.directions[k]
        np.testing.assert_allclose(lines.extents[k], [along.min(), along.max()], atol=1e-9)


def test_short_lines_are_dropped():
    points = sweep_of(room_scan(sigma=0.005, seed=1))
    assert len(extract_lines(points, LinesConfig(min_length=3.5))) < 3
    assert len(extract_lines(points, LinesConfig(min_readings=400))) == 0


@given(st.integers(0, 10_000), st.floats(0.01, 5.0))
@settings(max_examples=30)
def test_the_nearest_line_is_the_nearest_segment(seed, max_distance):
    points = sweep_of(room_scan(sigma=0.01, seed=seed % 7, n_beams=91))
    lines = extract_lines(points, EVERY)
    points = np.random.default_rng(seed).uniform(-4, 4, (20, 2))
    line_idx, squared = nearest_lines(points, lines, max_distance)
    ends = lines.centres[:, None] + lines.extents[:, :, None] * lines.directions[:, None]
    for i, point in enumerate(points):
        away = [np.sum((twin.on_stretch(point, *pair) - point) ** 2) for pair in ends]
        if min(away) <= max_distance**2:
            assert away[line_idx[i]] == pytest.approx(min(away), rel=1e-9)
            assert squared[i] == pytest.approx(min(away), rel=1e-9, abs=1e-15)
        else:
            assert line_idx[i] == -1
            assert math.isinf(squared[i])
