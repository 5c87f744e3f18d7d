"""Maps on disk, read back by other readers (Pillow, PyYAML) and by the rules of Nav2's map_server."""

from __future__ import annotations

import errno
import math
import re
import time

import numpy as np
import pytest

from curvescan import LaserScan, _interrupts
from curvescan.errors import InvalidArgumentError, LogFileError, LogFormatError, OutputError
from curvescan.io.files.output import output_folder
from curvescan.mapping import map_server
from curvescan.mapping.config import OccupancyConfig
from curvescan.mapping.map_server import map_pixels, picture_of, read_map, write_map, write_map_files
from curvescan.mapping.occupancy import OccupancyBuilder, OccupancyGrid
from curvescan.plots.map import draw_occupancy

yaml = pytest.importorskip("yaml", reason="needs PyYAML")
Image = pytest.importorskip("PIL.Image", reason="needs Pillow")

OCCUPIED, FREE, UNKNOWN = 100, 0, -1


def load_as_nav2(path):
    """Return what Nav2's map_server makes of a map: cells row by row from the smallest y, resolution, origin."""
    described = yaml.safe_load(path.read_text())
    assert set(described) == {
        "image", "mode", "resolution", "origin", "negate", "occupied_thresh", "free_thresh",
    }  # fmt: skip
    assert described["mode"] == "trinary"
    with Image.open(path.parent / described["image"]) as image:
        assert image.mode == "L"
        shade = np.array(image) / 255.0
    occ = shade if described["negate"] else 1.0 - shade
    cells = np.full(occ.shape, UNKNOWN)
    cells[occ < described["free_thresh"]] = FREE
    cells[described["occupied_thresh"] < occ] = OCCUPIED
    return cells[::-1], described["resolution"], described["origin"]


@pytest.fixture
def grid():
    # a wall 2 m ahead, a post 1 m to the left, nothing to the right
    builder = OccupancyBuilder()
    angles = np.arange(-90, 91) * (np.pi / 180)
    ranges = np.where(np.abs(angles) < 0.7, 2.0 / np.cos(angles), np.nan)
    ranges[-1], ranges[0] = 1.0, math.inf
    scan = LaserScan(ranges, angle_min=angles[0], angle_increment=np.pi / 180, range_max=3.0)
    builder.add(scan, (0.51, -0.26, 0.0))
    return builder.grid()


def test_a_map_comes_back_as_nav2_loads_it(tmp_path, grid):
    write_map(tmp_path, grid)
    cells, resolution, (x, y, yaw) = load_as_nav2(tmp_path / "map.yaml")
    np.testing.assert_array_equal(cells == OCCUPIED, grid.is_occupied)
    np.testing.assert_array_equal(cells == FREE, grid.is_free)
    np.testing.assert_array_equal(cells == UNKNOWN, grid.log_odds == 0.0)
    assert {OCCUPIED, FREE, UNKNOWN} == set(np.unique(cells).tolist())
    assert resolution == 0.05
    np.testing.assert_allclose((x, y), grid.origin, atol=1e-12)
    assert yaw == 0.0

    def at(east, north):
        return cells[math.floor((north - y) / resolution), math.floor((east - x) / resolution)]

    # the world of the fixture, neither mirrored nor turned
    assert at(0.51 + 2.0, -0.26) == OCCUPIED
    assert at(0.51 + 2.0, -0.26 + 1.2) == OCCUPIED
    assert at(0.51, -0.26 + 1.0) == OCCUPIED
    assert at(0.51, -0.26 - 1.0) == FREE
    assert at(0.51 + 1.0, -0.26) == FREE
    assert at(0.51 + 0.1, -0.26 - 1.0) == UNKNOWN


def test_the_top_row_of_the_picture_is_the_largest_y(tmp_path, grid):
    write_map(tmp_path, grid, name="office")
    assert yaml.safe_load((tmp_path / "office.yaml").read_text())["image"] == "office.pgm"
    with Image.open(tmp_path / "office.pgm") as image:
        pixels = np.array(image)
    assert set(np.unique(pixels).tolist()) == {0, 205, 254}
    rows = np.flatnonzero((pixels == 0).any(axis=1))
    # the wall's upper end, 1.65 m north of the sensor, is the highest row
    assert rows[0] == 0
    assert (grid.is_occupied[-1]).any()


def test_a_map_without_cells_and_a_place_that_is_no_folder_are_told(tmp_path, grid):
    with pytest.raises(InvalidArgumentError, match="at least one cell"):
        write_map(tmp_path, OccupancyBuilder().grid())
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match="is a file"):
        write_map(tmp_path / "file", grid)
    with pytest.raises(OutputError, match="cannot write"):
        write_map(tmp_path, grid, "a\0b")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_disk_that_is_full_leaves_the_old_map(tmp_path, grid, monkeypatch):
    write_map(tmp_path, grid)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}

    def full(_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(map_server, "map_pixels", full)
    with pytest.raises(OutputError, match="make room"):
        write_map(tmp_path, grid)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_a_map_is_written_as_part_of_a_larger_result(tmp_path, grid, monkeypatch):
    monkeypatch.setattr(_interrupts, "_sentences", [_interrupts.NOTHING_WRITTEN])
    with output_folder(tmp_path / "out") as folder:
        write_map_files(folder, grid)
        assert {path.name for path in folder.iterdir()} == {"map.pgm", "map.yaml"}
        assert _interrupts._sentences == [_interrupts.NOTHING_WRITTEN]
    assert str(tmp_path / "out") in _interrupts._sentences[0]
    np.testing.assert_array_equal(read_map(tmp_path / "out" / "map.yaml").is_free, grid.is_free)


@pytest.mark.parametrize("name", ["floor #2", "a: b", '"q"', "it's", "[x]", "floor/2"])
def test_any_name_of_a_map_is_read_back(tmp_path, grid, name):
    write_map(tmp_path, grid, name)
    path = tmp_path / f"{name}.yaml"
    assert yaml.safe_load(path.read_text())["image"] == f"{path.stem}.pgm"
    np.testing.assert_array_equal(read_map(path).is_occupied, grid.is_occupied)


@pytest.mark.parametrize("n_most", [800, 10])
def test_the_picture_shows_the_map_upright(tmp_path, grid, n_most):
    draw_occupancy(tmp_path / "a.png", grid.blocks(n_most), np.array([[0.51, -0.26, 0.0]]), title="room")
    with Image.open(tmp_path / "a.png") as image:
        grey = np.array(image.convert("L"))
    # the wall stands in the right half, from y = -1.9 up to the top; title and names of the axes are left out
    left, top, middle = grey.shape[1] // 5, grey.shape[0] // 6, grey.shape[0] // 2
    dark = (grey[top:middle, left:] < 60).mean(axis=0)
    assert left + dark.argmax() > 0.6 * grey.shape[1]


def test_a_wall_of_one_cell_stays_dark_in_the_picture_of_a_large_place(tmp_path):
    log_odds = np.full((4000, 9000), -2.0, dtype=np.float32)
    log_odds[2003] = 5.0
    grid = OccupancyGrid(log_odds=log_odds, origin=np.zeros(2), config=OccupancyConfig())
    draw_occupancy(tmp_path / "a.png", grid.blocks(700), np.zeros((1, 3)), title="hall")
    with Image.open(tmp_path / "a.png") as image:
        grey = np.array(image.convert("L"))
    middle = grey[:, grey.shape[1] // 4 : 3 * grey.shape[1] // 4]
    assert (middle < 60).all(axis=1).any()  # a row that is dark from side to side


def test_a_map_comes_back_as_it_was_written(tmp_path):
    log_odds = np.zeros((4, 5), dtype=np.float32)
    log_odds[1, 2], log_odds[3, 0] = 2.0, -1.0
    write_map(tmp_path, OccupancyGrid(log_odds=log_odds, origin=np.array([-1.5, 2.0]), config=OccupancyConfig()))
    grid = read_map(tmp_path / "map.yaml")
    np.testing.assert_array_equal(np.sign(grid.log_odds), np.sign(log_odds))
    assert grid.is_occupied[1, 2]
    assert grid.is_free[3, 0]
    assert grid.origin.tolist() == [-1.5, 2.0]


def test_a_map_as_others_write_it_is_read_alike(tmp_path):
    log_odds = np.zeros((4, 5), dtype=np.float32)
    log_odds[1, 2], log_odds[3, 0] = 2.0, -1.0
    grid = OccupancyGrid(log_odds=log_odds, origin=np.array([-1.5, 2.0]), config=OccupancyConfig())
    write_map(tmp_path, grid)
    ours = read_map(tmp_path / "map.yaml")
    # dark and light are the other way round, a PNG of three colours, a list on lines of its own, comments
    Image.fromarray(255 - map_pixels(grid)).convert("RGB").save(tmp_path / "foreign.png")
    (tmp_path / "foreign.yaml").write_text(
        "# CREATOR: someone\nimage: 'foreign.png'  # beside it\nresolution: 0.05\norigin:\n- -1.5\n- 2.0\n- 0.0\n"
        "negate: 1\noccupied_thresh: 0.9 # strict\nfree_thresh: 0.1\n"
    )
    foreign = read_map(tmp_path / "foreign.yaml")
    np.testing.assert_array_equal(foreign.log_odds, ours.log_odds)
    assert foreign.origin.tolist() == [-1.5, 2.0]
    # thresholds decide: what is 55 % dark is occupied for one and unknown for the other
    Image.fromarray(np.full((4, 5), 115, dtype=np.uint8)).save(tmp_path / "foreign.png")
    text = (tmp_path / "foreign.yaml").read_text().replace("negate: 1", "negate: 0")
    for threshold, is_occupied in ((0.5, True), (0.6, False)):
        (tmp_path / "grey.yaml").write_text(text.replace("0.9", str(threshold)))
        assert read_map(tmp_path / "grey.yaml").is_occupied.all() == is_occupied


def test_a_picture_of_16_bits_is_scaled(tmp_path):
    pixels = np.array([[0, 20_000, 65_535]], dtype=">u2")
    (tmp_path / "deep.pgm").write_bytes(b"P5\n3 1\n65535\n" + pixels.tobytes())
    (tmp_path / "deep.yaml").write_text(
        "image: deep.pgm\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.2\n"
    )
    grid = read_map(tmp_path / "deep.yaml")
    assert grid.is_occupied[0].tolist() == [True, True, False]
    assert grid.is_free[0].tolist() == [False, False, True]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ((b"P5", b"P9"), "map.pgm is neither a PGM"),
        ((b"trinary", b"raw"), "mode must be trinary or scale, got raw"),
        ((b"5 4", b"5 5"), "a byte for each of 5 x 5 pixels, got 20"),
        ((b"5 4", b"5 3"), "a byte for each of 5 x 3 pixels, got 20"),
        ((b"255\n", b"255\r\n"), "a byte for each of 5 x 4 pixels, got 21"),
        ((b"[0, 0, 0.0]", b"[0, nan, 0.0]"), "origin must be 3 finite numbers"),
        ((b"[0, 0, 0.0]", b"[0, 0, -inf]"), "origin must be 3 finite numbers"),
        ((b"[0, 0, 0.0]", b"[0, 0]"), "origin must be 3 finite numbers"),
        ((b"0.65", b"nan"), "occupied_thresh must be 1 finite number"),
        ((b"negate: 0", b"negate: maybe"), "negate must be 0 or 1, got 'maybe'"),
        ((b"image", b"#" * (1 << 16) + b"\nimage"), "it is longer than 64 KiB"),
        ((b"resolution", b"solution"), "it has no resolution"),
        ((b"map.pgm", b"[map.pgm]"), "image must be one value"),
        ((b"map.pgm", b"'map.pgm"), "while scanning a quoted scalar"),
        ((b"image: ", b"- image: "), "while parsing a block collection|it is no table"),
        ((b"mode: trinary", b"mode: {trinary: 1}"), "mode must be one value"),
        ((b"mode: ", b"a: " + 200 * b"[" + b"\nmode: "), "it has more than 100 lists"),
        ((b"mode: ", b"a:\n  " + 9000 * b"- " + b"\nmode: "), "recursion depth"),
    ],
)
def test_a_map_that_cannot_be_read_is_refused(tmp_path, change, message):
    grid = OccupancyGrid(log_odds=np.ones((4, 5), dtype=np.float32), origin=np.zeros(2), config=OccupancyConfig())
    write_map(tmp_path, grid)
    for file in tmp_path.iterdir():
        file.write_bytes(file.read_bytes().replace(*change))
    with pytest.raises(LogFormatError, match=message):
        read_map(tmp_path / "map.yaml")
    with pytest.raises(LogFileError):
        read_map(tmp_path / "none.yaml")


@pytest.mark.parametrize(
    "change",
    [
        (b"image: ", b"\xef\xbb\xbfimage: "),
        (b"\n", b"\r\n"),
        (b"[1, 2,", b"[1,  # two lines\n  2,"),
        (b"[1, 2, 0.0]", b"\n  - 1\n  # y\n\n  - 2\n  - 0.0"),
        (b"0.196\n", b"0.196\n...\n"),
        (b"map.pgm", b"'map.pgm'  # it's here"),
        (b"map.pgm", b'"m\\x61p.pgm"'),
        (b"map.pgm", b"\t>-\n  map.pgm"),
        (b"0.65\nfree_thresh: 0.196", b"&a 0.65\nother: *a\nagain: &a 1\nfree_thresh: 0.196\t# sure"),
        (b"negate: 0", b"negate: 0\nnegate: 1"),
    ],
)
def test_a_map_is_written_in_many_ways_of_yaml(tmp_path, change):
    log_odds = np.array([[1.0, 0.0, -1.0]], dtype=np.float32)
    write_map(tmp_path, OccupancyGrid(log_odds=log_odds, origin=np.array([1.0, 2.0]), config=OccupancyConfig()))
    path = tmp_path / "map.yaml"
    before = path.read_bytes()
    path.write_bytes(before.replace(*change))
    assert path.read_bytes() != before
    grid = read_map(path)
    np.testing.assert_array_equal(np.sign(grid.log_odds), log_odds)
    assert grid.origin.tolist() == [1.0, 2.0]


def test_a_quote_within_the_name_of_a_picture_is_written_twice(tmp_path, grid):
    write_map(tmp_path, grid)
    (tmp_path / "map.pgm").rename(tmp_path / "it's.pgm")
    path = tmp_path / "map.yaml"
    path.write_text(path.read_text().replace("map.pgm", "'it''s.pgm'"))
    np.testing.assert_array_equal(read_map(path).is_occupied, grid.is_occupied)
    assert picture_of(path).name == "it's.pgm"


def test_aliases_that_multiply_take_no_memory(tmp_path, grid):
    write_map(tmp_path, grid)
    path, lists = tmp_path / "map.yaml", ["a0: &a0 [x]"]
    lists += [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, 30)]
    for name in ("origin", "image", "free_thresh"):
        changed = re.sub(f"(?m)^{name}: .*", f"{name}: *a29", path.read_text())
        (tmp_path / "bomb.yaml").write_text("\n".join(lists) + "\n" + changed)
        with pytest.raises(LogFormatError, match=f"{name} must be one value"):
            read_map(tmp_path / "bomb.yaml")


@pytest.mark.parametrize("value", ["1", "yes", "True", "ON", "'true'"])
def test_a_picture_that_is_negated_is_turned(tmp_path, value):
    write_map(
        tmp_path, OccupancyGrid(log_odds=np.ones((1, 2), np.float32), origin=np.zeros(2), config=OccupancyConfig())
    )
    path = tmp_path / "map.yaml"
    path.write_text(path.read_text().replace("negate: 0", f"negate: {value}"))
    assert read_map(path).is_free.all()


@pytest.mark.parametrize("change", [(b"255\n", b"# by hand\n255\n"), (b"\xfe", b"\xfe\n")])
def test_comments_and_a_last_newline_belong_to_a_picture(tmp_path, change):
    log_odds = np.array([[1.0, 0.0], [0.0, -1.0]], dtype=np.float32)
    write_map(tmp_path, OccupancyGrid(log_odds=log_odds[::-1], origin=np.zeros(2), config=OccupancyConfig()))
    picture = tmp_path / "map.pgm"
    picture.write_bytes(picture.read_bytes().replace(*change))
    np.testing.assert_array_equal(np.sign(read_map(tmp_path / "map.yaml").log_odds), log_odds[::-1])


@pytest.mark.parametrize(
    ("name", "content"), [("map.pgm", b"P5\n" + 26 * b"# " + b"\nx"), ("map.yaml", 60_000 * b"\n" + b"image: none.pgm")]
)
def test_a_small_file_takes_little_time(tmp_path, grid, name, content):
    write_map(tmp_path, grid)
    (tmp_path / name).write_bytes(content)
    begin = time.process_time()
    with pytest.raises(LogFormatError):
        read_map(tmp_path / "map.yaml")
    assert time.process_time() - begin < 2.0  # seconds: the first picture loads Pillow


def test_a_picture_that_breaks_off_is_told(tmp_path, grid):
    write_map(tmp_path, grid)
    (tmp_path / "map.pgm").write_bytes(b"P5\n6 4\n65535\n12345")
    with pytest.raises(LogFormatError, match=r"map\.pgm is neither a PGM"):
        read_map(tmp_path / "map.yaml")


def test_a_map_that_is_none_is_told(tmp_path):
    with pytest.raises(InvalidArgumentError, match="grid must be an OccupancyGrid, got NoneType"):
        write_map(tmp_path, None)
