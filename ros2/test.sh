#!/usr/bin/env bash
# Run the tests of the ROS 2 node: test.sh VENV PYTHON. Installs rclpy from the package index, for tests only.
set -euo pipefail
cd "$(dirname "$0")/.."
venv=$PWD/${1:-.venv-ros} python=${2:-python3}

if [ ! -e "$venv/.installed" ]; then
    "$python" -m venv "$venv"
    "$venv/bin/python" -m pip install --quiet --disable-pip-version-check . pytest \
        || { echo "ROS 2: skipped, curvescan cannot be installed into $venv"; exit 1; }
    if ! "$venv/bin/python" -m pip install --quiet --disable-pip-version-check -r ros2/requirements-test.txt; then
        echo "ROS 2: skipped, the wheels of rclpy are not to be had for this machine (Linux x86_64, Python 3.10 to 3.14)"
        exit 0
    fi
    touch "$venv/.installed"
fi
export NUMBA_CACHE_DIR="${NUMBA_CACHE_DIR:-$PWD/.cache/kernels-ros}" MPLBACKEND=Agg PYTHONPATH="$PWD/src"
# what the rebuilt packages bring along (lark) warns of its own age
"$venv/bin/python" -m pytest -q -p no:cacheprovider -rs -W ignore::DeprecationWarning ros2/curvescan_ros/test
