"""Connected components of a pose graph, and which pose of each is held."""

from __future__ import annotations

import numpy as np

from curvescan.types import Ints


def components(ends: Ints, n_poses: int) -> Ints:
    """Return (n_poses,) number of the connected component of each pose, the one of pose 0 first.

    ends (m, 2).
    """
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import connected_components

    links = csr_matrix((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(n_poses, n_poses))
    _, labels = connected_components(links, directed=False)
    return np.asarray(labels, dtype=np.int64)


def anchors_of(labels: Ints, preferred: Ints | None = None) -> Ints:
    """Return one pose of each component, in the order of the components: a preferred one, or else the first."""
    _, first = np.unique(labels, return_index=True)
    anchors = first.astype(np.int64)
    if preferred is not None:
        anchors[labels[preferred][::-1]] = preferred[::-1]
    return anchors
