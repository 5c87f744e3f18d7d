"""
Two scans and their match
=========================

Two scans of one office, half a metre and 30 degrees apart, matched without a guess. The second scan is drawn where the match puts it.
"""

import matplotlib.pyplot as plt
import numpy as np

import curvescan as cs
from curvescan.simulation import simulate_pairs

pair = simulate_pairs("office", sensor="hokuyo-270", motions=[[0.5, 0.2, np.radians(30.0)]], seed=7)[0]
result = cs.match(pair.reference, pair.current)
print(result)

fig, (before, after) = plt.subplots(1, 2, figsize=(9, 5), sharex=True, sharey=True, layout="constrained")
for ax, pose, title in ((before, np.zeros(3), "as measured"), (after, result.pose, "matched")):
    ax.plot(*pair.reference.points.T, ".", color="0.65", ms=4, label="reference")
    ax.plot(*cs.se2.transform(pose, pair.current.points).T, ".", color="tab:blue", ms=3, label="current")
    ax.set(title=title, xlabel="x [m]", aspect="equal")
before.set_ylabel("y [m]")
fig.legend(*after.get_legend_handles_labels(), loc="outside lower center", ncols=2, markerscale=2)
plt.show()
