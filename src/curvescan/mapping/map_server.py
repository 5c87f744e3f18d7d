"""A map as ROS's map_server and Nav2 load it: an 8-bit PGM picture and a YAML file that says where it lies.

Nav2, nav2_map_server, mode trinary: a pixel's occupancy is (255 - value) / 255; above occupied_thresh it is occupied,
below free_thresh free, else unknown. The customary values are 0, 254 and 205. The last is an occupancy of 0.19608:
just above 0.196, so that it is unknown, but below the 0.25 that Nav2's own map_saver writes and with which unknown
places come back as free. Hence 0.196 here.
"""

import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from curvescan.errors import InvalidArgumentError, LogFileError, LogFormatError, OutputError
from curvescan.mapping.config import OccupancyConfig
from curvescan.mapping.grid_editing import moved
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
    """Return the uint8 picture of a map: 0 occupied, 205 unknown, 254 free; the top row has the largest y."""
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
        When the map is none, or has no cells.
    OutputError
        When the files cannot be written.
    """
    if not isinstance(grid, OccupancyGrid):
        raise InvalidArgumentError(
            f"grid must be an OccupancyGrid, got {type(grid).__name__}: OccupancyBuilder().grid() is one"
        )
    if not grid.log_odds.size:
        raise InvalidArgumentError("a map must have at least one cell: no scan had a reading")
    n_rows, n_columns = grid.log_odds.shape
    x, y = grid.origin.tolist()
    try:
        with (Path(folder) / f"{name}.pgm").open("wb") as file:
            file.write(b"P5\n%d %d\n255\n" % (n_columns, n_rows))
            for row in range(n_rows - 1, -1, -1):  # a row at a time: the map is large
                file.write(map_pixels(replace(grid, log_odds=grid.log_odds[row : row + 1])).data)
        (Path(folder) / f"{name}.yaml").write_text(
            _YAML.format(image=f"{name}.pgm", resolution=grid.resolution, x=x, y=y), encoding="utf-8", newline="\n"
        )
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise OutputError(f"cannot write {name}.pgm and {name}.yaml into the folder {folder}: {reason}") from error


def read_map(path: str | os.PathLike[str]) -> OccupancyGrid:
    """Return a map of map_server: what its thresholds call occupied and free, as sure as a grid can be."""
    path = Path(path)
    try:
        # a list may stand on lines of its own
        text = re.sub(r"\n\s*-\s+", ", ", re.sub(r"\s#.*|^#.*", "", path.read_text("utf-8"), flags=re.MULTILINE))
        lines = (line.partition(":") for line in text.splitlines())
        values = {key.strip(): value.strip(" ,'\"") for key, _, value in lines}
        x, y, yaw = (float(v) for v in values["origin"].strip("[]").split(","))
        pixels = _pixels(path.parent / values["image"])
        if values.get("mode", "trinary") not in ("trinary", "scale"):
            raise ValueError(f"mode must be trinary or scale, got {values['mode']}: save it anew")
        is_dark = values.get("negate", "0").lower() not in ("1", "true")
        share = (255.0 - pixels if is_dark else pixels) / 255.0
        is_occupied = share > float(values.get("occupied_thresh", "0.65"))
        is_free = share < float(values.get("free_thresh", "0.196"))
        config = OccupancyConfig(resolution=float(values["resolution"]))
    except OSError as error:
        raise LogFileError(f"map {path} cannot be read: {error.filename}: {error.strerror or error}") from error
    except KeyError as error:
        raise LogFormatError(f"{path} is no map of map_server that can be read: it has no {error.args[0]}") from error
    except ValueError as error:
        raise LogFormatError(f"{path} is no map of map_server that can be read: {error}") from error
    surest = np.log([config.highest / (1.0 - config.highest), config.lowest / (1.0 - config.lowest)])
    log_odds = np.where(is_occupied, surest[0], np.where(is_free, surest[1], 0.0)).astype(np.float32)
    log_odds = np.ascontiguousarray(log_odds[::-1])
    if yaw == 0.0:
        return OccupancyGrid(log_odds=log_odds, origin=np.array([x, y]), config=config)
    return moved(OccupancyGrid(log_odds=log_odds, origin=np.zeros(2), config=config), (x, y, yaw))


def _pixels(path: Path) -> NDArray[np.uint8]:
    """Return the grey values of a picture, a PGM or what Pillow reads; colours are averaged, as map_server does."""
    data = path.read_bytes()
    header = re.match(rb"P5\s+(?:#[^\n]*\s+)*(\d+)\s+(\d+)\s+(\d+)\s", data)
    if header is None or int(header[3]) != 255:
        from PIL import Image, UnidentifiedImageError  # a map is read as PGM, mostly

        try:
            with Image.open(path) as picture:
                if picture.mode.startswith("I"):  # of 16 bits
                    return np.asarray(np.asarray(picture) // 257, dtype=np.uint8)
                return np.asarray(np.asarray(picture.convert("RGB")).mean(axis=2), dtype=np.uint8)
        except (UnidentifiedImageError, Image.DecompressionBombError):
            raise ValueError(f"its picture {path.name} is neither a PGM (P5) nor any other that can be read") from None
    n_columns, n_rows = int(header[1]), int(header[2])
    if len(data) - header.end() != n_columns * n_rows or not n_columns * n_rows:
        raise ValueError("its picture is cut short")
    return np.frombuffer(data, np.uint8, offset=header.end()).reshape(n_rows, n_columns)
