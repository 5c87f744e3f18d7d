"""Segmentation (eq. 2) against its slow twin, and the choices the paper leaves open."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from curvescan import InvalidArgumentError, LaserScan
from curvescan.matchers.cfsma.config import SegmentationConfig
from curvescan.matchers.cfsma.segmentation import segment
from curvescan.scan import valid_readings
from tests.reference import cfsma as twin
from tests.scenes import room_scan

CONFIG = SegmentationConfig(range_sigma=0.01, min_readings=3, max_gap=2)


def as_groups(segments):
    return [segments.order[start:stop].tolist() for start, stop in zip(segments.starts, segments.stops, strict=True)]


def segments_of(scan, config=CONFIG):
    return segment(valid_readings(scan), config)


readings = st.one_of(st.floats(0.5, 6.0), st.floats(2.0, 2.05), st.just(math.nan), st.floats(2.0, 2.2))


@given(st.lists(readings, max_size=60), st.booleans(), st.integers(0, 4), st.integers(3, 6), st.sampled_from([1, -1]))
def test_agrees_with_the_slow_twin(ranges, is_circle, max_gap, min_readings, sign):
    increment = sign * (2 * math.pi / max(len(ranges), 8) if is_circle else math.radians(1.0))
    scan = LaserScan(ranges, angle_min=0.3, angle_increment=increment, range_max=8.0)
    config = SegmentationConfig(max_gap=max_gap, min_readings=min_readings)
    found = valid_readings(scan)
    assert as_groups(segment(found, config)) == twin.segments(
        found.ranges,
        found.angles,
        is_closed=found.is_closed,
        angle_step=found.angle_step,
        range_sigma=config.range_sigma,
        incidence_limit=config.incidence_limit,
        min_readings=min_readings,
        max_gap=max_gap,
    )


def step_scan(*, gap=0, **kwargs):
    """A wall at 2 m whose middle `gap` readings are missing, then a wall at 4 m."""
    ranges = np.concatenate([np.full(40, 2.0), np.full(40, 4.0)])
    ranges[20 : 20 + gap] = np.nan
    return LaserScan(ranges, angle_min=0.0, angle_increment=math.radians(0.5), **kwargs)


def test_a_step_in_depth_is_a_breakpoint():
    assert [len(g) for g in as_groups(segments_of(step_scan()))] == [40, 40]


@pytest.mark.parametrize(("gap", "groups"), [(2, [38, 40]), (3, [20, 17, 40])])
def test_only_a_long_gap_ends_a_segment(gap, groups):
    assert [len(g) for g in as_groups(segments_of(step_scan(gap=gap)))] == groups


def test_isolated_groups_are_dropped():
    ranges = np.full(30, 2.0)
    ranges[10:14] = 1.0
    scan = LaserScan(ranges, angle_min=0.0, angle_increment=0.01)
    assert [len(g) for g in as_groups(segments_of(scan, SegmentationConfig(min_readings=4)))] == [10, 4, 16]
    assert [len(g) for g in as_groups(segments_of(scan, SegmentationConfig(min_readings=5)))] == [10, 16]


@pytest.mark.parametrize("n_beams", [359, 360, 361])
def test_a_full_circle_joins_at_the_seam_wherever_that_is(n_beams):
    # two walls: near over half the circle, far over the other; the seam falls inside the near one
    increment = math.radians(1.0)
    angles = increment * np.arange(n_beams)
    ranges = np.where(np.cos(angles) > 0, 2.0, 4.0)
    scan = LaserScan(ranges, angle_min=0.0, angle_increment=increment, range_max=8.0)
    groups = as_groups(segments_of(scan))
    assert len(groups) == 2
    near = next(g for g in groups if 0 in g)
    assert n_beams - 1 in near
    assert near.index(0) == near.index(n_beams - 1) + 1


def test_a_round_room_is_one_segment():
    scan = LaserScan(np.full(360, 3.0), angle_min=0.0, angle_increment=math.radians(1.0))
    assert as_groups(segments_of(scan)) == [list(range(360))]


@pytest.mark.parametrize("n_beams", [0, 1, 2])
def test_too_few_readings_make_no_segment(n_beams):
    scan = LaserScan(np.ones(n_beams), angle_min=0.0, angle_increment=0.01)
    assert len(segments_of(scan)) == 0


def test_a_room_seen_from_inside_is_one_segment():
    assert [len(g) for g in as_groups(segments_of(room_scan(sigma=0.01)))] == [361]


@pytest.mark.parametrize(
    ("field", "value", "rule"),
    [
        ("range_sigma", -0.1, "range_sigma must be >= 0 m, got -0.1"),
        ("incidence_limit", 2.0, r"incidence_limit must lie in \(0, pi/2\) rad, got 2.0"),
        ("min_readings", 2, "min_readings must be at least 3, got 2"),
        ("max_gap", -1, "max_gap must be >= 0 readings, got -1"),
    ],
)
def test_configuration_rules(field, value, rule):
    with pytest.raises(InvalidArgumentError, match=rule):
        SegmentationConfig(**{field: value})
