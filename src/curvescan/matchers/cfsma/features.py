"""All that CF-SMA knows of one scan, computed once and used whether it is the current scan or the reference."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from curvescan.matchers.cfsma.config import CfSmaConfig
from curvescan.matchers.cfsma.curvature import curvature_functions
from curvescan.matchers.cfsma.functions import spectra
from curvescan.matchers.cfsma.landmarks import Landmarks, characteristic_points
from curvescan.matchers.cfsma.segmentation import segment
from curvescan.scan import LaserScan, valid_readings
from curvescan.types import Floats, Ints, Points


@dataclass(frozen=True, eq=False, kw_only=True)
class CfSmaFeatures:
    """Segments, curvature functions, spectra and characteristic points of one scan."""

    n_beams: int  # beams of the scan
    beam_idx: Ints  # (m,): the scan's own index of each valid reading, readings in sweep order
    points: Points  # (m, 2): the valid readings in sweep order, sensor frame, metres
    # starts, stops: (s,): segment k is points[starts[k]:stops[k]]
    starts: Ints
    stops: Ints
    eta: Floats  # (m,): curvature index of each reading, radians; 0 outside segments
    # (s, length // 2 + 1) complex128: spectrum of each segment's curvature function, of unit energy
    spectra: NDArray[np.complex128]
    landmarks: Landmarks  # characteristic points


def extract_features(scan: LaserScan, config: CfSmaConfig) -> CfSmaFeatures:
    """Return the features of a scan: CF-SMA1, and the part of CF-SMA2 that needs one scan only."""
    readings = valid_readings(scan)
    segments = segment(readings, config.segmentation)
    points = readings.points[segments.order]
    starts, stops = segments.starts, segments.stops
    eta, _ = curvature_functions(points, starts, stops, config.curvature)
    return CfSmaFeatures(
        n_beams=len(scan),
        beam_idx=readings.beam_idx[segments.order],
        points=points,
        starts=starts,
        stops=stops,
        eta=eta,
        spectra=spectra(eta, starts, stops, config.functions.length),
        landmarks=characteristic_points(eta, starts, stops, config.landmarks),
    )
