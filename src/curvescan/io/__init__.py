"""Bytes to scans, poses and maps, and back: the readers and writers of every format, and nothing else."""

from curvescan.io import datasets
from curvescan.io.arrays.memory import MemoryLog, log_from_arrays
from curvescan.io.config import read_config, write_config
from curvescan.io.files.lines import ReadError
from curvescan.io.files.output import output_folder
from curvescan.io.log import Log, pick_scans
from curvescan.io.reading import PoseFile, read_log, read_poses
from curvescan.io.sensor_setup import SensorSetup, apply_setup
from curvescan.io.trajectories.layouts import write_csv, write_tum
from curvescan.io.trajectories.relations import Relations, read_relations
from curvescan.io.trajectories.trajectory import Trajectory, read_csv, read_tum
from curvescan.io.writing import WRITERS, write_log

__all__ = [
    "WRITERS", "Log", "MemoryLog", "PoseFile", "ReadError", "Relations", "SensorSetup", "Trajectory",
    "apply_setup", "datasets", "log_from_arrays", "output_folder", "pick_scans", "read_config", "read_csv",
    "read_log", "read_poses", "read_relations", "read_tum", "write_config", "write_csv", "write_log",
    "write_tum",
]  # fmt: skip
