"""
A loop closed
=============

A robot drives round the corridors of a simulated floor and comes back to where it began. Odometry drifts; SLAM recognizes the place and revises the
whole trajectory.
"""

import matplotlib.pyplot as plt
import numpy as np

import curvescan as cs

log = cs.simulate("office-floor", n_scans=900, seed=2)
slam = cs.Slam()
odometry = []  # slam.odometry is the odometry in front: its poses drift and are never revised
for scan in log:
    odometry.append(slam.add(scan).pose_odom)
revised = slam.finish().poses

truth = cs.se2.between(log.truth.poses[0], log.truth.poses)
closures = sum(closure.is_accepted for closure in slam.closures)
print(f"{closures} loop closures between keyframes")

fig, axes = plt.subplots(1, 2, figsize=(11, 5), sharex=True, sharey=True, layout="constrained")
for ax, name, poses in zip(axes, ("odometry", "SLAM"), (np.array(odometry), revised), strict=True):
    error = np.hypot(*(poses - truth)[:, :2].T)
    print(f"{name}: mean error {error.mean():.3f} m, at the end {error[-1]:.3f} m")
    points = np.vstack([cs.se2.transform(p, s.points[::2]) for p, s in zip(poses, log, strict=True)])
    ax.plot(*points.T, ",", color="0.4")
    ax.plot(*truth[:, :2].T, color="tab:green", lw=2, label="true path")
    ax.plot(*poses[:, :2].T, color="tab:red", lw=1, label=name)
    ax.set(title=f"{name}: mean error {1000 * error.mean():.0f} mm", xlabel="x [m]", aspect="equal")
    ax.legend(loc="lower center", bbox_to_anchor=(0.5, -0.3), ncols=2)
axes[0].set_ylabel("y [m]")
plt.show()
