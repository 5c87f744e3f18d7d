"""
People dropped from a match
===========================

Readings on people who moved between two scans violate free space: the other scan looked through where they stand. They are labelled
``DYNAMIC`` and take no part in the pose.
"""

import matplotlib.pyplot as plt
import numpy as np

import curvescan as cs
from curvescan.simulation import simulate_pairs

pair = simulate_pairs("office", motions=[[0.2, 0.1, 0.1]], people_share=0.15, seed=3)[0]
result = cs.match(pair.reference, pair.current)
labels = result.labels_current

fig, ax = plt.subplots(figsize=(7, 5.5), layout="constrained")
ax.plot(*pair.reference.points.T, ".", color="0.8", ms=5, label="reference")
points = cs.se2.transform(result.pose, pair.current.points)
for name, colour in (("MATCHED", "tab:blue"), ("DYNAMIC", "tab:red"), ("NEW", "tab:green")):
    chosen = labels == cs.Label[name]
    ax.plot(*points[chosen].T, ".", color=colour, ms=4, label=name.lower())
ax.plot(*points[pair.is_person_cur].T, "o", mfc="none", mec="k", ms=7, lw=0.5, label="truly a person")
ax.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", title="what became of each reading")
ax.legend(loc="upper right")
plt.show()
