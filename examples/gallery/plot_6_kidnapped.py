"""
Kidnapped and found
===================

A map is made once. Later a sensor is switched on somewhere in it, drives on, and is carried to another room while nobody looks.
:class:`curvescan.Localizer` finds it without a guess, both times.
"""

import matplotlib.pyplot as plt
import numpy as np

import curvescan as cs

first = cs.simulate("office-floor", n_scans=900, seed=2)
slam = cs.Slam()
for scan in first:
    slam.add(scan)
slam.finish()

# %%
# The same floor on another day, people included: scans 200 to 260, then, carried away, 600 to 660.
second = cs.simulate("office-floor", n_scans=900, n_people=3, seed=2)
visited = [*range(200, 261), *range(600, 661)]
truth = cs.se2.between(first.truth.poses[0], second.truth.poses)

localizer = cs.Localizer(slam.map)
steps = [localizer.add(second[k]) for k in visited]
for k, step in zip(visited, steps, strict=True):
    if step.outcome.name == "FOUND":
        error = np.hypot(*(step.pose - truth[k])[:2])
        print(f"scan {k}: found, {1000 * error:.0f} mm from the truth")

# %%
# In black where the sensor was, in red where the localizer has it. While it is searched for it has no pose.
fig, ax = plt.subplots(figsize=(8, 6), layout="constrained")
for pose, scan in zip(slam.trajectory().poses[::5], list(first)[::5], strict=True):
    ax.plot(*cs.se2.transform(pose, scan.points).T, ",", color="0.6")
ax.plot(*truth[visited, :2].T, ".", color="k", ms=9, label="true positions")
found = np.array([step.pose for step in steps if step.ok])
ax.plot(*found[:, :2].T, ".", color="tab:red", ms=4, label="localized")
ax.annotate("", truth[600, :2], truth[260, :2], arrowprops={"arrowstyle": "->", "ls": "--"})
ax.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", title="carried from one room to another")
ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=2)
plt.show()
