"""Place index: which of very many keyframes look like a scan, without any idea of where it was taken.

After Himstedt, Frost, Hellbach, Böhme and Maehle, "Large scale place recognition in 2D LIDAR scans using geometrical
landmark relations" (GLARE), IROS 2014: a scan is described by a histogram over pairs of landmarks, of their distance
and of the bearing of one from the other's own direction. Both stay as they are when the sensor moves or turns.
Departure: landmarks are points of all surfaces with their normals, and find more places again than corners do.
Histograms are compared by their cosine after a square root (Arandjelovic and Zisserman 2012), which is one product with
a matrix: tens of milliseconds for 100,000 keyframes.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from curvescan._jit import kernel
from curvescan.slam.pose_graph.rows import Rows
from curvescan.types import Floats, Ints

N_DISTANCES, N_BEARINGS, N_KINDS = 16, 12, 3
"""Bins of distance, of bearing, and whether both surfaces face alike, against each other, or across."""

_STEP = 0.5
"""Width of a bin of distance, metres; pairs farther apart than 8 m are left out."""

SIGNATURE_SIZE = N_DISTANCES * N_BEARINGS * N_KINDS
Signature = NDArray[np.float32]
"""(SIGNATURE_SIZE,) float32 of unit length, or zeros where a scan has too few points."""


def signature(points: Floats) -> Signature:
    """Return the signature of a scan from points of its surfaces, (k, 4) float64: places, metres, and unit normals."""
    found = np.sqrt(_histogram(np.ascontiguousarray(points)))
    return np.asarray(found / (np.linalg.norm(found) or 1.0), dtype=np.float32)


class PlaceIndex(Rows):
    """Signatures of keyframes, by row."""

    def __init__(self) -> None:
        super().__init__((SIGNATURE_SIZE,), np.float32)

    def similarity(self, other: Signature) -> Floats:
        """Return (n,) how alike each keyframe is to a scan, in [0, 1]."""
        # not by BLAS: its threads spin on for milliseconds, and sum in an order that depends on how many there are
        return np.asarray(np.einsum("nd,d->n", self.array, other), dtype=np.float64)

    def most_similar(self, other: Signature, n_most: int) -> Ints:
        """Return the keyframes most like a scan, the most alike first."""
        return np.argsort(-self.similarity(other), kind="stable")[:n_most].astype(np.int64)


@kernel
def _histogram(points: Floats) -> Floats:
    """Return the weights of all pairs, shared among the neighbouring bins of distance and bearing."""
    counts = np.zeros(N_DISTANCES * N_BEARINGS * N_KINDS)
    for a in range(len(points)):
        nx, ny = points[a, 2], points[a, 3]
        for b in range(len(points)):
            dx, dy = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
            distance = math.sqrt(dx * dx + dy * dy)
            if a == b or distance < 0.5 * _STEP or distance >= _STEP * (N_DISTANCES - 0.5):
                continue
            bearing = math.atan2(nx * dy - ny * dx, nx * dx + ny * dy)
            alike = nx * points[b, 2] + ny * points[b, 3]
            kind = 0 if alike > 0.5 else 1 if alike < -0.5 else 2
            d, t = distance / _STEP - 0.5, bearing / (2.0 * math.pi) * N_BEARINGS - 0.5
            d0, t0 = math.floor(d), math.floor(t)
            for i in range(2):
                row = int(d0) + i
                by_distance = 1.0 - abs(d - row)
                if row < 0 or row >= N_DISTANCES:
                    continue
                for j in range(2):
                    column = int(t0) + j
                    weight = by_distance * (1.0 - abs(t - column))
                    counts[(row * N_BEARINGS + column % N_BEARINGS) * N_KINDS + kind] += weight
    return counts
