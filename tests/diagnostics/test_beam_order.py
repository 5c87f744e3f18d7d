"""Which way a log's beams were swept, told by the scans themselves."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

import curvescan as cs
from curvescan.diagnostics.sensor import BeamOrder, beam_order_of_log, judge_sensor
from curvescan.io import SensorSetup, apply_setup, read_log
from curvescan.simulation import SENSORS
from curvescan.simulation.driving.pursuit import Drive

SENSOR = SENSORS["spinning-360"]
SWEPT = replace(SENSOR, time_increment=SENSOR.period / SENSOR.n_beams)


@pytest.mark.slow
def test_a_lively_drive_tells_the_order_of_the_beams():
    drive = Drive(turn_rate=2.0, acceleration=1.5)
    log = cs.simulate("office", sensor=SWEPT, n_scans=200, seed=1, drive=drive)
    judged = judge_sensor(log)
    assert judged.beam_order.is_forwards
    assert judged.can_deskew
    assert not judge_sensor(apply_setup(log, SensorSetup(backwards=True))).can_deskew


def test_what_cannot_tell_says_nothing():
    for without_beam_times in (cs.simulate("office", sensor=SENSOR, n_scans=4, seed=1), []):
        assert beam_order_of_log(without_beam_times) is None
    short = cs.simulate("office", sensor=SWEPT, n_scans=4, seed=1)
    order = beam_order_of_log(short)
    assert order.n_pairs == 0
    assert math.isnan(order.gain)
    assert not order.is_reversed_order
    assert not order.is_forwards
    assert judge_sensor(short).can_deskew
    one = BeamOrder(n_pairs=1, gain=-1.0, standard_error=math.nan)
    assert not one.is_reversed_order


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "is_reversed_order"),
    [("turtlebot4-rplidar/macfirst_floor_take_2", True), ("ccny-handheld-hokuyo/demo.bag", False)],
)
def test_real_logs(real_data, name, is_reversed_order):
    assert beam_order_of_log(read_log(real_data / name)).is_reversed_order is is_reversed_order
    if is_reversed_order:
        assert beam_order_of_log(read_log(real_data / name, backwards=True)).is_forwards
