"""A map as ROS's map_server and Nav2 load it: an 8-bit PGM picture and a YAML file that says where it lies.

Nav2, nav2_map_server, mode trinary: a pixel's occupancy is (255 - value) / 255; above occupied_thresh it is occupied,
below free_thresh free, else unknown. The customary values are 0, 254 and 205. The last is an occupancy of 0.19608:
just above 0.196, so that it is unknown, but below the 0.25 that Nav2's own map_saver writes and with which unknown
places come back as free. Hence 0.196 here.
"""

import json
import os
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from curvescan.errors import InvalidArgumentError, LogFileError, LogFormatError, OutputError
from curvescan.io.files.lines import as_path
from curvescan.io.files.output import output_folder
from curvescan.mapping.config import OccupancyConfig
from curvescan.mapping.grid_editing import moved
from curvescan.mapping.occupancy import OccupancyGrid

OCCUPIED, UNKNOWN, FREE = 0, 205, 254

_MAX_YAML, _MAX_HEADER = 1 << 16, 1 << 12  # characters of a YAML file, bytes of a PGM's header
_MAX_LISTS = 100  # in a YAML file: the time that the parser takes grows with the square of their depth
_PGM = re.compile(rb"(?:\s|#[^\n]*\n)+".join((rb"P5", rb"(\d{1,9})", rb"(\d{1,9})", rb"255\s")))
_BOOLS = dict.fromkeys(("0", "n", "no", "false", "off"), False) | dict.fromkeys(("1", "y", "yes", "true", "on"), True)

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
    """Write a map as NAME.pgm and NAME.yaml into a folder, both or none.

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
    target = as_path(folder, "the folder of a map") / name
    try:
        with output_folder(target.parent) as new:
            write_map_files(new, grid, target.name)
    except ValueError as error:  # of a name that is none
        raise OutputError(f"cannot write {name!r} into the folder {folder}: {error}") from error


def write_map_files(folder: Path, grid: OccupancyGrid, name: str = "map") -> None:
    """Write a map as :func:`write_map` does, into a folder of results that are moved together."""
    n_rows, n_columns = grid.log_odds.shape
    x, y = grid.origin.tolist()
    picture = f"{name}.pgm"
    is_plain = re.fullmatch(r"[\w.-]+", picture)
    image = picture if is_plain else json.dumps(picture, ensure_ascii=False)  # YAML has its texts in quotes alike
    with (folder / picture).open("wb") as file:
        file.write(b"P5\n%d %d\n255\n" % (n_columns, n_rows))
        for row in range(n_rows - 1, -1, -1):  # a row at a time: the map is large
            file.write(map_pixels(replace(grid, log_odds=grid.log_odds[row : row + 1])).data)
    text = _YAML.format(image=image, resolution=grid.resolution, x=x, y=y)
    (folder / f"{name}.yaml").write_text(text, encoding="utf-8", newline="\n")


def read_map(path: str | os.PathLike[str]) -> OccupancyGrid:
    """Return a map of map_server: what its thresholds call occupied and free, as sure as a grid can be."""
    path = as_path(path, "a map")
    with _reading(path):
        fields = _fields(path)
        x, y, yaw = _numbers("origin", fields["origin"], 3)
        pixels = _pixels(path.parent / _text("image", fields["image"]))
        mode, negate = (_text(name, fields.get(name, usual)) for name, usual in (("mode", "trinary"), ("negate", "0")))
        if mode not in ("trinary", "scale"):
            raise ValueError(f"mode must be trinary or scale, got {mode}: save it anew")
        is_light = _BOOLS.get(negate.lower())
        if is_light is None:
            raise ValueError(f"negate must be 0 or 1, got {negate!r:.80}")
        share = (pixels if is_light else 255.0 - pixels) / 255.0
        is_occupied = share > _numbers("occupied_thresh", fields.get("occupied_thresh", "0.65"))[0]
        is_free = share < _numbers("free_thresh", fields.get("free_thresh", "0.196"))[0]
        config = OccupancyConfig(resolution=_numbers("resolution", fields["resolution"])[0])
    surest = np.log([config.highest / (1.0 - config.highest), config.lowest / (1.0 - config.lowest)])
    log_odds = np.where(is_occupied, surest[0], np.where(is_free, surest[1], 0.0)).astype(np.float32)
    log_odds = np.ascontiguousarray(log_odds[::-1])
    if yaw == 0.0:
        return OccupancyGrid(log_odds=log_odds, origin=np.array([x, y]), config=config)
    return moved(OccupancyGrid(log_odds=log_odds, origin=np.zeros(2), config=config), (x, y, yaw))


def picture_of(path: Path) -> Path:
    """Return the picture that the YAML file of a map names."""
    with _reading(path):
        return path.parent / _text("image", _fields(path)["image"])


@contextmanager
def _reading(path: Path) -> Iterator[None]:
    """Say as a LogFileError or LogFormatError why a map cannot be read."""
    try:
        yield
    except OSError as error:
        raise LogFileError(f"map {path} cannot be read: {error.filename}: {error.strerror or error}") from error
    except KeyError as error:
        raise LogFormatError(f"{path} is no map of map_server that can be read: it has no {error.args[0]}") from error
    except ValueError as error:
        raise LogFormatError(f"{path} is no map of map_server that can be read: {error}") from error


def _fields(path: Path) -> dict[str, Any]:
    """Return the values of a YAML file by their names, the first of each: texts, and lists of them."""
    from ruamel.yaml import YAML  # few maps are read
    from ruamel.yaml.error import YAMLError

    with path.open(encoding="utf-8-sig") as file:
        text = file.read(_MAX_YAML + 1)
    if len(text) > _MAX_YAML:
        raise ValueError(f"it is longer than {_MAX_YAML >> 10} KiB")
    yaml = YAML(typ="base", pure=True)
    yaml.allow_duplicate_keys = True
    if text.count("[") + text.count("{") > _MAX_LISTS:
        raise ValueError(f"it has more than {_MAX_LISTS} lists")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # two values may have one anchor
            fields = yaml.load(text.replace("\t", " "))  # it takes no tab between two words
    except (YAMLError, RecursionError) as error:
        raise ValueError(str(error).partition("\n")[0]) from None
    if not isinstance(fields, dict):
        raise LogFormatError("it is no table of names and values")
    return fields


def _text(name: str, value: object) -> str:
    if not isinstance(value, str):
        raise LogFormatError(f"{name} must be one value")
    return value


def _numbers(name: str, value: object, n: int = 1) -> list[float]:
    texts = [_text(name, one) for one in (value if isinstance(value, list) else [value])]
    numbers = [float(text) for text in texts]
    if len(numbers) != n or not np.isfinite(numbers).all():
        raise ValueError(f"{name} must be {n} finite number{'s' * (n > 1)}, got {', '.join(texts)!r:.80}")
    return numbers


def _pixels(path: Path) -> NDArray[np.uint8]:
    """Return the grey values of a picture, a PGM or what Pillow reads; colours are averaged, as map_server does."""
    data = path.read_bytes()
    header = _PGM.match(data, 0, _MAX_HEADER)
    if header is None:
        from PIL import Image  # a map is read as PGM, mostly

        try:
            with Image.open(path) as picture:
                if picture.mode.startswith("I"):  # of 16 bits
                    return np.asarray(np.asarray(picture) // 257, dtype=np.uint8)
                return np.asarray(np.asarray(picture.convert("RGB")).mean(axis=2), dtype=np.uint8)
        except (OSError, Image.DecompressionBombError):
            raise ValueError(f"its picture {path.name} is neither a PGM (P5) nor any other that can be read") from None
    n_columns, n_rows = int(header[1]), int(header[2])
    n, beyond = n_columns * n_rows, header.end() + n_columns * n_rows
    if not n or len(data) < beyond or data[beyond:].strip():
        got = len(data) - header.end()
        raise ValueError(f"its picture must have a byte for each of {n_columns} x {n_rows} pixels, got {got}")
    return np.frombuffer(data, np.uint8, n, header.end()).reshape(n_rows, n_columns)
