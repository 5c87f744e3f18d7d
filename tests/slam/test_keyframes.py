"""Keyframes: which of their matches count."""

import numpy as np
import pytest

import curvescan as cs
from curvescan.matchers import find_matcher
from curvescan.slam.keyframes import Keyframes


@pytest.mark.parametrize("off", [0.0, 2.0])  # metres from the middle, about which any turn is as likely
def test_in_a_round_room_no_keyframes_match(off: float) -> None:
    poses = np.array([[off, 0.0, 0.0], [off + 0.02, 0.0, 0.1]])
    keyframes = Keyframes(find_matcher("curvescan"))
    for k, scan in enumerate(cs.simulate("round-room", poses=poses, odometry_noise=None)):
        keyframes.add(scan, k)
    one, other = keyframes.prepared(0), keyframes.prepared(1)
    assert one.matcher.match(one.features, other.features, None).ok
    found = keyframes.match(0, other, None)
    assert not found.ok
    assert np.isnan(found.pose).all()
