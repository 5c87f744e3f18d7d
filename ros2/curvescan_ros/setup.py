"""curvescan_ros: an ament_python package; curvescan itself is installed with pip."""

from pathlib import Path

from setuptools import setup

PACKAGE = "curvescan_ros"

setup(
    name=PACKAGE,
    version="0.1.0",
    packages=[PACKAGE],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        (f"share/{PACKAGE}/launch", [str(p) for p in Path("launch").glob("*.launch.py")]),
        (f"share/{PACKAGE}/rviz", [str(p) for p in Path("rviz").glob("*.rviz")]),
        (f"share/{PACKAGE}/config", [str(p) for p in Path("config").glob("*.yaml")]),
    ],
    install_requires=["setuptools", "curvescan"],
    zip_safe=True,
    maintainer="The curvescan developers",
    maintainer_email="curvescan@users.noreply.github.com",
    description="2D laser odometry, SLAM and localization with curvescan",
    license="BSD-3-Clause",
    entry_points={"console_scripts": ["node = curvescan_ros.node:main"]},
)
