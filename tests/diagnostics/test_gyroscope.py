"""What sure matches say of a gyroscope: a bias is found, bent sweeps are straightened, straight ones are left."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from curvescan.deskew import deskew
from curvescan.diagnostics.motion_prior import judge_gyroscope
from curvescan.diagnostics.preparation import mend
from tests.diagnostics.test_inspect import FakeLog
from tests.scenes import room_scan

PERIOD = 0.14
# stands, and turns by up to 20 degrees a sweep, now to the left and now to the right
STEPS = np.radians([0.0, 0.0] + [(0.0, 8.0, 20.0, -14.0, -20.0, 12.0)[k % 6] for k in range(58)])
HEADINGS = np.cumsum(STEPS)


class Rover(FakeLog):
    """A log of a rover on the spot, its sweeps bent by its turn where they take time, with a gyroscope."""

    def __init__(self, *, is_bent: bool, bias: float = 0.0) -> None:
        scans = []
        for k, (heading, step) in enumerate(zip(HEADINGS, STEPS, strict=True)):
            scan = room_scan((0.4, 0.3, heading - 0.5 * step * is_bent), sigma=0.005, seed=k, stamp=PERIOD * k)
            if is_bent:  # as a sweep is seen that the sensor turns in: the opposite of straightening it
                timed = replace(scan, time_increment=PERIOD / len(scan))
                bent = deskew(timed, (0.0, 0.0, -step / PERIOD))
                scan = replace(bent, stamp=PERIOD * k, time_increment=0.0)
            scans.append(scan)
        super().__init__(scans)
        self.turned = HEADINGS + bias * PERIOD * np.arange(len(STEPS))

    def turned_by_gyro(self):
        return self.turned


@pytest.mark.parametrize("is_bent", [True, False])
def test_bent_sweeps_and_no_others_are_straightened(is_bent):
    log = Rover(is_bent=is_bent)
    found = judge_gyroscope(log, log.turned)
    assert found.n_turns >= 30
    assert found.straightens is is_bent
    assert not found.is_biased
    assert ("bent_sweeps" in {issue.kind for issue in mend(log).done}) is is_bent


def test_a_bias_is_taken_off():
    bias = math.radians(-30.0)
    log = Rover(is_bent=False, bias=bias)
    assert judge_gyroscope(log, log.turned).bias == pytest.approx(bias, abs=math.radians(0.5))
    mended = mend(log)
    assert "gyro_bias" in {issue.kind for issue in mended.done}
    # a turn of the whole log that the bias was found to half a degree a second leaves
    left = np.abs(mended.log.turned_by_gyro() - HEADINGS)
    assert left.max() < math.radians(0.5) * PERIOD * len(STEPS)
