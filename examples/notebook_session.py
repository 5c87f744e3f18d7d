"""A session as in a notebook: read a log, match two scans, run the odometry, and look at all of it."""

import sys
from pathlib import Path

import matplotlib.pyplot as plt

import curvescan as cs

log = cs.read_log(sys.argv[1]) if len(sys.argv) > 1 else cs.simulate("office-floor", n_scans=400)
print(log, log[0], log[10:20], sep="\n")

result = cs.match(log[0], log[8])
print(result)

run = cs.run(log, config={"keyframes": {"distance": 0.6}})
print(run, run.trajectory, sep="\n")

figure, (left, middle, right) = plt.subplots(1, 3, figsize=(18, 6), layout="constrained")
cs.plot.match(result, ax=left)
cs.plot.trajectory(run, ax=middle, label="scan matching")
cs.plot.map(run, ax=right)

folder = Path("notebook")
folder.mkdir(exist_ok=True)
figure.savefig(folder / "session.png", dpi=80)
run.trajectory.write(folder / "trajectory.csv")
print(cs.Trajectory.read(folder / "trajectory.csv"))
