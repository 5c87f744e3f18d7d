"""
A loop closed
=============

A robot with a cheap laser (181 beams, 30 mm of noise, 8 m) drives round the corridors of a simulated floor and comes back to where it began.
Odometry drifts: its walls are double where the robot returns. SLAM recognizes the place and revises the whole trajectory.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import curvescan as cs
from curvescan.simulation import SENSORS

sick = SENSORS["sick-lms200"]
laser = replace(sick, n_beams=181, angle_increment=np.radians(1.0), sigma_range=0.03)
log = cs.simulate("office-floor", sensor=laser, seed=2)
slam = cs.Slam()
# the poses of the odometry in front of SLAM drift, and are never revised
odometry = np.array([slam.add(scan).pose_odom for scan in log])
revised = slam.finish().poses

truth = cs.se2.between(log.truth.poses[0], log.truth.poses)
n_closures = sum(closure.is_accepted for closure in slam.closures)
print(f"{n_closures} loop closures between keyframes")

# %%
# Both trajectories in the frame of the building, so that they can be laid over the true one.
fig, axes = plt.subplots(1, 2, figsize=(12, 5), sharex=True, sharey=True, layout="constrained")
for ax, name, poses in zip(axes, ("odometry", "SLAM"), (odometry, revised), strict=True):
    error = np.hypot(*(poses - truth)[:, :2].T)
    print(f"{name}: error {error.mean():.3f} m in the mean, {error.max():.3f} m at most")
    poses = cs.se2.compose(log.truth.poses[0], poses)
    points = [cs.se2.transform(p, scan.points) for p, scan in zip(poses, log, strict=True)]
    ax.plot(*np.vstack(points).T, ",", color="0.4")
    ax.plot(*log.truth.poses[:, :2].T, color="tab:green", lw=2.5, label="true path")
    ax.plot(*poses[:, :2].T, color="tab:red", lw=1, label="estimated path")
    ax.set(title=f"{name}: mean error {100 * error.mean():.0f} cm", xlabel="x [m]", aspect="equal")
axes[0].set_ylabel("y [m]")
fig.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
plt.show()
