"""A k-d tree for ICP, from SciPy where it is installed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from curvescan.errors import MissingPackageError
from curvescan.types import Points

if TYPE_CHECKING:
    from scipy.spatial import cKDTree


def plant_tree(points: Points) -> cKDTree:
    """Return a k-d tree of (n, 2) points.

    Raises
    ------
    MissingPackageError
        When SciPy is not installed.
    """
    try:
        from scipy.spatial import cKDTree
    except ImportError as error:
        raise MissingPackageError(
            'method "icp" needs SciPy: pip install "curvescan[icp]"'
        ) from error
    return cKDTree(points)
