"""Stamps that belong together: exact first, then near, in file order whatever the clock does."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import curvescan as cs
from curvescan.evaluation.relations import associate, find_stamps
from tests.reference import trajectory_errors as slow

STAMPS = st.lists(st.integers(0, 60).map(lambda k: k / 8), min_size=1, max_size=25, unique=True)


@given(STAMPS, STAMPS, st.sampled_from([0.0, 0.125, 0.3, 2.0]))
def test_association_is_the_slow_ones(first, second, tolerance):
    pairs = associate(np.array(first), np.array(second), tolerance=tolerance)
    expected = slow.associate(first, second, tolerance)
    assert list(zip(pairs.first.tolist(), pairs.second.tolist(), strict=True)) == expected
    assert pairs.n_exact == len(set(first) & set(second))
    assert pairs.by == "stamp"


def test_an_equal_stamp_wins_over_a_nearer_neighbour_in_the_file():
    # the clock goes back by 0.9 s: the nearest in the file is not the one of the same time
    first = np.array([0.0, 1.0, 0.1, 2.0])
    second = np.array([0.1, 1.995])
    pairs = associate(first, second, tolerance=0.2)
    assert pairs.first.tolist() == [2, 3]
    assert pairs.second.tolist() == [0, 1]
    assert pairs.n_exact == 1


def test_a_few_repeated_stamps_are_paired_in_their_order():
    stamps = np.array([0.0, 1.0, 1.0, 2.0, 3.0])
    assert associate(stamps, stamps).second.tolist() == [0, 1, 2, 3, 4]
    assert associate(stamps, stamps).by == "stamp"


def test_stamps_that_tell_nothing_are_paired_in_their_order():
    useless, good = np.full(5, 1.01893e9), np.arange(5.0)
    pairs = associate(useless, good)
    assert pairs.by == "order"
    assert pairs.first.tolist() == pairs.second.tolist() == [0, 1, 2, 3, 4]
    with pytest.raises(cs.InvalidArgumentError, match="equally many: got 5 and 4"):
        associate(useless, good[:4])


def test_wanted_stamps_are_found_unless_they_could_be_several():
    stamps = np.array([5.0, 3.0, 4.0, 4.00005, 7.0, 7.0])
    wanted = np.array([4.0, 4.00005, 3.00009, 3.001, 7.0, 5.0, 5.0, -1.0, 99.0])
    assert find_stamps(stamps, wanted).tolist() == [2, 3, 1, -1, -1, 0, 0, -1, -1]
    assert find_stamps(np.empty(0), wanted).tolist() == [-1] * len(wanted)


def test_every_stamp_of_a_clock_that_goes_back_is_found(real_data):
    path = real_data / "intel-lab" / "intel.clf.gz"
    if not path.exists():
        pytest.skip(f"{path} is not there")
    stamps = cs.read_log(path).odometry.stamps
    assert np.count_nonzero(np.diff(stamps) < 0.0) == 631
    np.testing.assert_array_equal(find_stamps(stamps, stamps), np.arange(len(stamps)))
    # two stamps are 6 us apart: within any tolerance, and yet told apart
    pairs = associate(stamps, stamps[::5], tolerance=0.5)
    np.testing.assert_array_equal(pairs.first, np.arange(0, len(stamps), 5))
