"""Pose graphs as g2o's text, for a back end that closes loops: VERTEX_SE2, EDGE_SE2, FIX.

g2o (Kuemmerle et al., "g2o: a general framework for graph optimization", 2011) takes the error of an edge in the frame
of the measured pose: delta = measurement^-1 (x_i^-1 x_j). Our covariances are of x, y, theta in the frame of scan i, so
each is turned by -theta before it is inverted to the information matrix.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence

import numpy as np

from curvescan.errors import InvalidArgumentError
from curvescan.io.trajectories.layouts import checked, writing_text
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.types import Bools, Cov, PoseEdge

_UPPER = np.triu_indices(3)


def write_g2o(path: str | os.PathLike[str], trajectory: Trajectory, edges: Iterable[PoseEdge]) -> None:
    """Write a pose graph: a vertex a pose, by its number, and an edge a measurement; vertex 0 is fixed.

    Parameters
    ----------
    path : str or path-like
        The file, replaced if it exists.
    trajectory : Trajectory
        Where the optimiser starts; a pose of NaN has no vertex.
    edges : iterable of PoseEdge
        Between poses that are known.

    Raises
    ------
    InvalidArgumentError
        When an edge leads to a vertex that is not there, or its covariance is not positive definite.
    OutputError
        When the file cannot be written.
    """
    known: Bools = np.asarray(np.all(np.isfinite(checked(trajectory).poses), axis=1))
    with writing_text(path) as file:
        for i in np.flatnonzero(known).tolist():
            file.write(f"VERTEX_SE2 {i} {_row(trajectory.poses[i].tolist())}\n")
        for edge in edges:
            for k in (edge.i, edge.j):
                if not (0 <= k < len(known) and known[k]):
                    raise InvalidArgumentError(
                        f"an edge must join known poses, got {edge.i} to {edge.j} of {len(known)}"
                    )
            information = information_of(edge)[_UPPER].tolist()
            file.write(f"EDGE_SE2 {edge.i} {edge.j} {_row(edge.pose.tolist())} {_row(information)}\n")
        # last: some readers of the format stop at a word that they do not know
        if known.any():
            file.write(f"FIX {int(np.argmax(known))}\n")


def information_of(edge: PoseEdge) -> Cov:
    """Return the (3, 3) information matrix of an edge in the frame of its measured pose."""
    cos, sin = np.cos(edge.pose[2]), np.sin(edge.pose[2])
    turn = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    try:
        lower = np.linalg.cholesky(turn @ edge.covariance @ turn.T)
    except np.linalg.LinAlgError:
        raise InvalidArgumentError(
            f"the covariance of an edge must be positive definite, got {edge.covariance.tolist()} from {edge.i} to "
            f"{edge.j}"
        ) from None
    inverse = np.linalg.inv(lower)
    return inverse.T @ inverse


def _row(values: Sequence[float]) -> str:
    return " ".join(map(repr, values))
