"""
People dropped from a match
===========================

Readings on people who moved between two scans violate free space: the other scan looked through where they stand. They are labelled
``DYNAMIC`` and take no part in the pose.
"""

import matplotlib.pyplot as plt

import curvescan as cs
from curvescan.simulation import simulate_pairs

pair = simulate_pairs("office", motions=[[0.2, 0.1, 0.1]], people_share=0.15, seed=3)[0]
result = cs.match(pair.reference, pair.current)
labels = result.labels_current

fig, ax = plt.subplots(figsize=(7, 7), layout="constrained")
ax.plot(*pair.reference.points.T, ".", color="0.8", ms=5, label="reference")
points = cs.se2.transform(result.pose, pair.current.points)
ax.plot(*points[pair.is_person_cur].T, "o", color="gold", ms=10, label="truly a person")
for name, colour in (("MATCHED", "tab:blue"), ("DYNAMIC", "tab:red"), ("NEW", "tab:green")):
    chosen = labels == cs.Label[name]
    ax.plot(*points[chosen].T, ".", color=colour, ms=4, label=name.lower())
ax.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", title="what became of each reading")
fig.legend(loc="outside lower center", ncols=3)
plt.show()
