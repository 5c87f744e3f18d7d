"""A driver loop: scans as they come, a pose and its covariance for each.

Here the scans are simulated; a robot would take them from its driver. Run it with: python examples/drive_loop.py
"""

import math

import curvescan as cs

odometry = cs.Odometry()
for scan in cs.simulate("office", n_scans=50, n_people=2, seed=1):
    step = odometry.add(scan)
    x, y, theta = step.pose
    sigma = math.sqrt(step.covariance[0, 0] + step.covariance[1, 1])
    print(
        f"{scan.stamp:6.2f} s  x {x:6.3f} m  y {y:6.3f} m  theta {math.degrees(theta):7.2f} deg  +- {sigma:.3f} m  {step.outcome.name.lower()}"
    )
