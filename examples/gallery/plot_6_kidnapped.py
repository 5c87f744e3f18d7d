"""
Kidnapped and found
===================

A map is made once. Later a sensor is switched on somewhere in it, drives on, and is carried to another place while nobody looks.
:class:`curvescan.Localizer` finds it without a guess, both times.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import curvescan as cs
from curvescan.simulation import SENSORS

laser = replace(SENSORS["sick-lms200"], n_beams=181, angle_increment=np.radians(1.0))
first = cs.simulate("office-floor", sensor=laser, seed=2)
slam = cs.Slam()
for scan in first:
    slam.add(scan)
slam.finish()

# %%
# The same floor on another day, people included: scans 200 to 260, then, carried away, 400 to 460.
second = cs.simulate("office-floor", sensor=laser, n_people=3, seed=2)
visited = [*range(200, 261), *range(400, 461)]
truth = cs.se2.between(first.truth.poses[0], second.truth.poses)

localizer = cs.Localizer(slam.map)
steps = [localizer.add(second[k]) for k in visited]
for k, step in zip(visited, steps, strict=True):
    if step.outcome.name == "FOUND":
        error = np.hypot(*(step.pose - truth[k])[:2])
        print(f"scan {k}: found, {1000 * error:.0f} mm from the truth")

# %%
# Between two matches with the map the odometry carries the pose on (``PREDICTED``, orange). Scans of a sensor that was carried away
# contradict the map: from then on it is searched for and has no pose, until it is found.
world = first.truth.poses[0]
fig, ax = plt.subplots(figsize=(9, 6.5), layout="constrained")
for pose, scan in zip(slam.trajectory().poses[::5], list(first)[::5], strict=True):
    ax.plot(*cs.se2.transform(cs.se2.compose(world, pose), scan.points).T, ",", color="0.5")
true = second.truth.poses
ax.plot(*true[visited, :2].T, ".", color="0.2", ms=10, label="true positions")
for names, colour, label in (
    (("PREDICTED",), "tab:orange", "carried on by the odometry"),
    (("FOUND", "TRACKED"), "tab:red", "matched with the map"),
):
    poses = [cs.se2.compose(world, s.pose) for s in steps if s.outcome.name in names]
    ax.plot(*np.reshape(poses, (-1, 3))[:, :2].T, ".", color=colour, ms=4, label=label)
ax.annotate("", true[400, :2], true[260, :2], arrowprops={"arrowstyle": "->", "ls": "--"})
ax.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", title="carried from one place to another")
fig.legend(loc="outside lower center", ncols=3, markerscale=1.5)
plt.show()
