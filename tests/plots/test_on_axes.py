"""cs.plot: what is drawn on the axes of a user."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure

import curvescan as cs
from tests.scenes import room_scan


@pytest.fixture
def axes():
    return Figure().subplots()


def test_a_match_is_drawn_where_it_puts_the_second_scan(axes):
    a, b = room_scan(sigma=0.005, seed=1), room_scan((0.1, 0.05, 0.1), sigma=0.005, seed=2)
    result = cs.match(a, b)
    assert cs.plot.match(result, ax=axes) is axes
    drawn = np.concatenate([line.get_xydata() for line in axes.lines if len(line.get_xydata())])
    moved = cs.se2.transform(result.pose, b.points)
    for point in (*a.points[::40], *moved[::40]):
        assert np.hypot(*(drawn - point).T).min() < 1e-12
    assert axes.get_aspect() == 1.0
    assert "readings matched" in axes.get_title()


def test_a_failed_match_is_drawn_with_its_reason(axes):
    blank = cs.LaserScan(np.full(90, np.nan), angle_min=-1.5, angle_increment=0.03)
    result = cs.match(blank, blank)
    cs.plot.match(result, ax=axes)
    assert result.outcome.value in axes.get_title().replace("\n", " ")
    assert max(map(len, axes.get_title().splitlines())) <= 45  # of a subplot


def test_the_match_of_an_odometry_needs_its_scans(axes):
    odometry, scan = cs.Odometry(), room_scan(sigma=0.005, seed=1)
    odometry.add(scan)
    step = odometry.add(scan)
    with pytest.raises(cs.InvalidArgumentError, match="give reference= and current="):
        cs.plot.match(step.match, ax=axes)
    cs.plot.match(step.match, scan, scan, ax=axes)
    with pytest.raises(cs.InvalidArgumentError, match="must be a MatchResult, got LaserScan"):
        cs.plot.match(scan, ax=axes)


def test_a_trajectory_is_drawn_with_its_ellipses(axes):
    log = cs.simulate("office", n_scans=8, seed=1)
    run = cs.run(log)
    cs.plot.trajectory(run, ax=axes, label="matching", c="green", linewidth=2.0)
    np.testing.assert_array_equal(axes.lines[0].get_xydata(), run.trajectory.poses[:, :2])
    assert axes.lines[0].get_color() == "green"
    assert len(axes.patches) == 8
    poses = run.trajectory.poses.copy()
    poses[3] = np.nan
    other = Figure().subplots()
    cs.plot.trajectory(poses, ax=other)
    assert len(other.lines[0].get_xydata()) == 7
    assert not other.patches
    with pytest.raises(cs.InvalidArgumentError, match=r"\(n, 3\), got ndarray of shape \(8, 2\)"):
        cs.plot.trajectory(poses[:, :2], ax=axes)


def test_an_ellipse_holds_three_sigma(axes):
    covariance = np.diag([0.04, 0.01, 0.0])
    trajectory = cs.Trajectory(stamps=[0.0], poses=[[1.0, 2.0, 0.5]], covariances=[covariance])
    cs.plot.trajectory(trajectory, ax=axes)
    corners = axes.patches[0].get_xy()
    np.testing.assert_allclose(np.abs(corners - [1.0, 2.0]).max(axis=0), [0.6, 0.3], rtol=0.01)


def test_a_map_is_drawn_from_a_grid_a_run_or_a_log(axes):
    log = cs.simulate("office", n_scans=8, seed=1)
    run = cs.run(log)
    builder = cs.OccupancyBuilder()
    for scan, pose in zip(log, run.trajectory.poses, strict=True):
        builder.add(scan, pose)
    images = []
    for source in (builder, builder.grid(), run):
        other = Figure().subplots()
        assert cs.plot.map(source, ax=other) is other
        images.append(other.images[0].get_array())
    other = Figure().subplots()
    cs.plot.map(log, run.trajectory, ax=other)
    images.append(other.images[0].get_array())
    for image in images[1:]:
        np.testing.assert_array_equal(image, images[0])
    assert len(np.unique(images[0].reshape(-1, 4), axis=0)) == 3  # unknown, free, occupied
    with pytest.raises(cs.InvalidArgumentError, match="give trajectory="):
        cs.plot.map(log, ax=axes)
    with pytest.raises(cs.InvalidArgumentError, match="must be a Run, a Slam"):
        cs.plot.map(3, ax=axes)
    with pytest.raises(cs.InvalidArgumentError, match="no cell"):
        cs.plot.map(cs.OccupancyBuilder(), ax=axes)


@pytest.mark.slow
def test_a_map_of_slam_is_drawn_with_its_legend_inside(tmp_path):
    slam = cs.Slam()
    for scan in cs.simulate("office", n_scans=30, seed=1):
        slam.add(scan)
    images = []
    path = tmp_path / "floor.csmap"
    slam.map.save(path)
    for source in (slam, slam.map, slam.map.occupancy(), path, cs.Localizer(str(path))):
        _, right = Figure(figsize=(8.0, 4.0)).subplots(1, 2)
        cs.plot.map(source, ax=right)
        images.append(right.images[0].get_array())
        right.figure.canvas.draw()
        legend, place = right.get_legend().get_window_extent(), right.get_window_extent()
        assert place.x0 <= legend.x0
        assert legend.x1 <= place.x1
    for image in images[1:]:
        np.testing.assert_array_equal(image, images[0])


def test_new_axes_are_made_where_none_are_given():
    import matplotlib.pyplot as plt

    axes = cs.plot.trajectory(np.zeros((2, 3)))
    assert axes.figure.number in plt.get_fignums()
    plt.close(axes.figure)
