"""
The covariance of a corridor
============================

Along a bare corridor motion is unobservable from a laser alone. The match says so: ``degenerate_direction`` names the change of pose, and the
covariance is a metre wide along it.
"""

import matplotlib.pyplot as plt
import numpy as np

import curvescan as cs
from curvescan.simulation import simulate_pairs

pair = simulate_pairs("bare-corridor", motions=[[0.3, 0.05, 0.02]], seed=2)[0]
result = cs.match(pair.reference, pair.current)
print(result)
print("degenerate direction:", np.round(result.degenerate_direction, 3))

fig, ax = plt.subplots(figsize=(6.5, 5.5), layout="constrained")
ax.plot(*pair.reference.points.T, ".", color="0.6", ms=4, label="reference")
ax.plot(*cs.se2.transform(result.pose, pair.current.points).T, ".", color="tab:blue", ms=3, label="current")
values, vectors = np.linalg.eigh(result.covariance[:2, :2])
angle = np.linspace(0.0, 2.0 * np.pi, 100)
ellipse = result.pose[:2, None] + vectors @ (np.sqrt(5.991 * values)[:, None] * [np.cos(angle), np.sin(angle)])
ax.plot(*ellipse, color="tab:red", label="95 % of the position")
ax.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", title="what the two scans determine, and what they do not")
fig.legend(loc="outside lower center", ncols=3)
plt.show()
