"""Simulated worlds, laser scanners, walking people and robots, with everything known.

Numba is loaded when the first ray is cast, not on import.
"""

from curvescan.simulation.buildings.catalogue import WORLDS, build_world
from curvescan.simulation.buildings.world import World
from curvescan.simulation.driving.pursuit import Drive, OdometryNoise, wheel_odometry
from curvescan.simulation.pairs import ScanPair, ScanPairs, simulate_pairs
from curvescan.simulation.recording import Simulation, simulate
from curvescan.simulation.sensing.people import People
from curvescan.simulation.sensing.sensors import SENSORS, Sensor, measure

__all__ = [
    "SENSORS", "WORLDS", "Drive", "OdometryNoise", "People", "ScanPair", "ScanPairs", "Sensor", "Simulation",
    "World", "build_world", "measure", "simulate", "simulate_pairs", "wheel_odometry",
]  # fmt: skip
