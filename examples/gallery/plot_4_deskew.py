"""
Deskewing a spinning lidar
==========================

A sensor that takes 0.1 s for a revolution and turns at 90 degrees a second sees its last beam 9 degrees from where the first one has it. With the
times of the beams the motion is removed.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

from curvescan.deskew import deskew
from curvescan.simulation import SENSORS, simulate

sensor = SENSORS["spinning-360"]
sensor = replace(sensor, time_increment=sensor.period / sensor.n_beams)
turning = np.column_stack([np.zeros((6, 2)), np.radians(90.0) * sensor.period * np.arange(6)])
log = simulate("room", sensor=sensor, poses=turning, seed=1)
scan = log[2]
corrected = deskew(scan, np.array([0.0, 0.0, np.radians(90.0)]))

fig, ax = plt.subplots(figsize=(6, 6), layout="constrained")
ax.plot(*scan.points.T, ".", color="tab:red", ms=3, label="as measured")
ax.plot(*corrected.points.T, ".", color="tab:blue", ms=3, label="deskewed")
ax.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", title="one sweep of a turning sensor")
fig.legend(loc="outside lower center", ncols=2, markerscale=2)
plt.show()
