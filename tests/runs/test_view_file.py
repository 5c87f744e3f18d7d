"""view.npz: scans to the centimetre, and what else the page of a finished run needs."""

import numpy as np

from curvescan import LaserScan, Slam, simulate
from curvescan.runs.graph_files import MAX_BEAMS, beams_of, read_view_file, write_view_file


def test_ranges_come_back_to_the_centimetre_with_their_angles(tmp_path):
    log = simulate("room", sensor="spinning-360", n_scans=3)
    write_view_file(tmp_path, log, 2)
    kept = read_view_file(tmp_path)
    assert kept["layout"].tolist() == [0, 0]  # two scans of three, one layout
    scan, n = log[1], int(kept["n_angles"][0])
    step = len(scan) // n
    assert n <= MAX_BEAMS
    np.testing.assert_allclose(kept["angles"], scan.angles[::step], atol=1e-6)  # float32
    seen = scan.valid[::step]
    np.testing.assert_allclose(0.01 * kept["ranges"][n:][seen], scan.ranges[::step][seen], atol=0.00501)
    assert (kept["ranges"][n:][~seen] == 0).all()
    assert kept["wheels"].shape == (2, 3)
    assert read_view_file(tmp_path / "elsewhere") == {}


def test_layouts_are_stored_once_and_a_reading_too_far_is_kept_as_far_as_it_goes():
    short = LaserScan(np.array([1.0, np.nan, 900.0]), angle_min=0.0, angle_increment=0.1, range_max=1000.0)
    long = LaserScan(np.array([1.0, 2.0]), angle_min=0.0, angle_increment=0.1, range_max=10.0)
    kept = beams_of([short, long, short])
    assert kept["layout"].tolist() == [0, 1, 0]
    assert kept["n_angles"].tolist() == [3, 2]
    assert kept["ranges"].tolist() == [100, 0, 65_000, 100, 200, 100, 0, 65_000]


def test_the_scan_of_each_keyframe_is_known():
    slam = Slam()
    steps = [slam.add(scan) for scan in simulate("room", sensor="spinning-360", n_scans=30)]
    first = {}
    for step in steps:
        first.setdefault(step.keyframe, step.index)
    assert dict(slam.records.keyframe_scans().tolist()) == first
    assert len(first) > 2
