"""Simulated worlds, laser scanners, walking people and robots, with everything known.

Numba is loaded when the first ray is cast, not on import.
"""

from __future__ import annotations

from curvescan.simulation.catalogue import WORLDS, build_world
from curvescan.simulation.pairs import ScanPair, ScanPairs, simulate_pairs
from curvescan.simulation.people import People
from curvescan.simulation.pursuit import Drive
from curvescan.simulation.recording import Simulation, simulate
from curvescan.simulation.sensors import SENSORS, Sensor, measure
from curvescan.simulation.wheels import OdometryNoise, wheel_odometry
from curvescan.simulation.world import World

__all__ = [
    "SENSORS",
    "WORLDS",
    "Drive",
    "OdometryNoise",
    "People",
    "ScanPair",
    "ScanPairs",
    "Sensor",
    "Simulation",
    "World",
    "build_world",
    "measure",
    "simulate",
    "simulate_pairs",
    "wheel_odometry",
]
