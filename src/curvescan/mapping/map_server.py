"""A map as ROS's map_server and Nav2 load it: an 8-bit PGM picture and a YAML file that says where it lies.

Nav2, nav2_map_server, mode trinary: a pixel's occupancy is (255 - value) / 255; above occupied_thresh it is occupied,
below free_thresh free, else unknown. The customary values are 0, 254 and 205. The last is an occupancy of 0.19608:
just above 0.196, so that it is unknown, but below the 0.25 that Nav2's own map_saver writes and with which unknown
places come back as free. Hence 0.196 here.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from curvescan.errors import InvalidArgumentError, OutputError
from curvescan.mapping.occupancy import OccupancyGrid

OCCUPIED, UNKNOWN, FREE = 0, 205, 254

_YAML = """\
image: {image}
mode: trinary
resolution: {resolution:.10g}
origin: [{x:.10g}, {y:.10g}, 0.0]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""


def map_pixels(grid: OccupancyGrid) -> NDArray[np.uint8]:
    """Return the (n_rows, n_columns) uint8 picture of a map: 0 occupied, 205 unknown, 254 free; the top row has the largest y."""
    pixels = np.full(grid.log_odds.shape, UNKNOWN, dtype=np.uint8)
    pixels[grid.is_occupied] = OCCUPIED
    pixels[grid.is_free] = FREE
    return pixels[::-1]


def write_map(folder: str | os.PathLike[str], grid: OccupancyGrid, name: str = "map") -> None:
    """Write a map as NAME.pgm and NAME.yaml into an existing folder.

    Parameters
    ----------
    folder : str or path-like
        Where to write; files of that name are replaced.
    grid : OccupancyGrid
        A map of at least one cell.
    name : str
        Name of the files without ending; the YAML file names the picture beside it.

    Raises
    ------
    InvalidArgumentError
        When the map has no cells.
    OutputError
        When the files cannot be written.
    """
    if not grid.log_odds.size:
        raise InvalidArgumentError("a map must have at least one cell: no scan had a reading")
    pixels = map_pixels(grid)
    n_rows, n_columns = pixels.shape
    x, y = grid.origin.tolist()
    try:
        (Path(folder) / f"{name}.pgm").write_bytes(b"P5\n%d %d\n255\n" % (n_columns, n_rows) + pixels.tobytes())
        (Path(folder) / f"{name}.yaml").write_text(
            _YAML.format(image=f"{name}.pgm", resolution=grid.resolution, x=x, y=y), encoding="utf-8", newline="\n"
        )
    except (OSError, ValueError) as error:
        raise OutputError(f"cannot write {Path(folder) / name}: {error}") from error
