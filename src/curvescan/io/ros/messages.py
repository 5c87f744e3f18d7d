"""ROS messages: from bytes to fields, by the bag's own definition of a type or by the bundled one; LaserScan."""

import math
import re
from collections.abc import Sequence
from functools import cache
from typing import Any

from rosbags.interfaces import Connection, MessageDefinitionFormat
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from curvescan.errors import InvalidArgumentError, LogFormatError
from curvescan.io.files.lines import ZSTD_MAGIC, BrokenRecordError
from curvescan.scan import LaserScan

LASER_SCAN = "sensor_msgs/msg/LaserScan"
ODOMETRY = "nav_msgs/msg/Odometry"
OCCUPANCY_GRID = "nav_msgs/msg/OccupancyGrid"
IMU = "sensor_msgs/msg/Imu"
TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
_WANTED = (LASER_SCAN, ODOMETRY, IMU, *TRANSFORMS)
MAX_MESSAGE_BYTES = 8 << 20  # longest message that is read: a scan of two million beams
_MAX_DEFINITION_CHARS = 1 << 16
_MAX_EXPRESSIONS = 400
_IDL_TEXTS = re.compile(r'"(\\.|[^"\\])*"|//[^\n]*|/\*.*?\*/', re.DOTALL)
_IDL_RULE = "=" * 80 + "\n"


class Decoder:
    """Decodes the messages of one bag, by the bag's own definition of a type where it has one that can be understood.

    Else by the bundled one: ROS 1 Noetic, ROS 2 Humble.
    """

    def __init__(self, connections: Sequence[Connection], *, is_ros1: bool) -> None:
        self._is_ros1 = is_ros1
        self._bundled = bundled_types(is_ros1)
        self._stores = dict.fromkeys(_WANTED, self._bundled)
        self.notes: list[str] = []
        for msgtype in _WANTED:
            of_type = (c for c in connections if c.msgtype == msgtype)
            defined = (c for c in of_type if c.msgdef.format is not MessageDefinitionFormat.NONE)
            if connection := next(defined, None):
                self._use_definition(connection)

    def decode(self, data: bytes, msgtype: str) -> Any:
        """Return a message of one of the types above with its fields as attributes. Raises BrokenRecordError."""
        if len(data) > MAX_MESSAGE_BYTES:
            raise BrokenRecordError(f"{short_name(msgtype)} message longer than 8 MiB")
        store = self._stores[msgtype]
        decode = store.deserialize_ros1 if self._is_ros1 else store.deserialize_cdr
        try:
            return decode(data, msgtype)
        except Exception as error:  # generated code on hostile bytes: any builtin error
            rule = f"{short_name(msgtype)} message that cannot be decoded"
            if bytes(data[:4]) == ZSTD_MAGIC:
                rule += " (zstd-compressed message by message: convert the bag to an uncompressed one)"
            raise BrokenRecordError(rule) from error

    def _use_definition(self, connection: Connection) -> None:
        try:
            definitions = _parse(connection)
            is_empty = not definitions[connection.msgtype][1]
            if is_empty or definitions.items() <= self._bundled.fielddefs.items():
                return
            store = get_typestore(Stores.EMPTY)
            store.register(definitions)
            store.get_msgdef(connection.msgtype)  # compiles it, so that it fails here if ever
        except Exception:  # noqa: BLE001 - a parser on hostile text; the bundled definition stands
            self.notes.append(
                f"the bag's own definition of {short_name(connection.msgtype)} cannot be understood: "
                "the usual one is taken"
            )
        else:
            self._stores[connection.msgtype] = store


@cache
def bundled_types(is_ros1: bool) -> Typestore:
    """Return the usual definitions, ROS 1 Noetic's or ROS 2 Humble's, with both names of the transforms."""
    store = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)
    for name in TRANSFORMS:
        if name not in store.fielddefs:
            definition = "geometry_msgs/TransformStamped[] transforms"
            store.register(get_types_from_msg(definition, name))
    return store


def stamp_of(header: Any) -> float:
    """Return the stamp of a std_msgs/Header, seconds, correctly rounded."""
    return float((header.stamp.sec * 10**9 + header.stamp.nanosec) / 10**9)


def short_name(msgtype: str) -> str:
    """Return a type's name as people write it: ``"sensor_msgs/LaserScan"``."""
    return shown(msgtype.replace("/msg/", "/"))


def shown(name: str) -> str:
    """Return a name of a bag fit to be printed: what no ROS name holds is replaced by ``?``, long ones are cut."""
    kept = "".join(ch if (ch.isascii() and ch.isalnum()) or ch in "_/~-. " else "?" for ch in name)
    return kept if len(kept) <= 80 else f"{kept[:77]}..."


def _parse(connection: Connection) -> dict[str, Any]:
    text = connection.msgdef.data
    if len(text) > _MAX_DEFINITION_CHARS:
        raise LogFormatError("definition too long")
    if connection.msgdef.format is MessageDefinitionFormat.MSG:
        return get_types_from_msg(text, connection.msgtype)
    _check_idl(text)
    parts = text.split(_IDL_RULE)[1:] if text.startswith(_IDL_RULE) else [f"\n{text}"]
    definitions: dict[str, Any] = {}
    for part in parts:
        definitions |= get_types_from_idl(part.partition("\n")[2])
    return definitions


def _check_idl(text: str) -> None:
    """Raise LogFormatError for IDL that keeps its parser busy: each level of brackets beyond ROS's multiplies work."""
    bare = _IDL_TEXTS.sub("", text)
    for opening, closing, deepest in ("(", ")", 1), ("<", ">", 2):
        depth = 0
        for ch in bare:
            depth = max(depth + (ch == opening) - (ch == closing), 0)
            if depth > deepest:
                raise LogFormatError("definition with nested brackets")
    if sum(map(bare.count, "=[@(+-*/%|^&")) > _MAX_EXPRESSIONS:
        raise LogFormatError("definition with too many expressions")


NO_FIELDS = "LaserScan message without the usual fields"


def scan_of(message: Any, *, stamp: float | None = None, range_max: float | None = None) -> LaserScan:
    """Return the LaserScan of a sensor_msgs/LaserScan message. Raises BrokenRecordError."""
    try:
        angle_min, step = float(message.angle_min), float(message.angle_increment)
        low = float(message.range_min)
        high = float(message.range_max) if range_max is None else range_max
        when = stamp_of(message.header) if stamp is None else stamp
        ranges, intensities = message.ranges, message.intensities
        n_beams, n_intensities = len(ranges), len(intensities)
    except (AttributeError, TypeError, ValueError, OverflowError) as error:
        raise BrokenRecordError(NO_FIELDS) from error
    times = _times(message)
    try:
        return LaserScan(
            ranges,
            angle_min=angle_min,
            angle_increment=step,
            range_min=low,
            range_max=high,
            stamp=when,
            intensities=intensities if n_beams == n_intensities > 0 else None,
            time_increment=_seconds(times[0]),
            scan_time=_seconds(times[1]),
        )
    except InvalidArgumentError as error:
        # one with a cause quotes what stands in place of the readings
        raise BrokenRecordError(NO_FIELDS if error.__cause__ else f"LaserScan message: {error}") from error


def has_bad_times(message: Any) -> bool:
    """Return whether time_increment or scan_time of a message is negative, infinite or not a number."""
    return not all(0.0 <= t < math.inf for t in _times(message))


def _times(message: Any) -> tuple[float, float]:
    try:
        return float(message.time_increment), float(message.scan_time)
    except (AttributeError, TypeError, ValueError, OverflowError):
        return 0.0, 0.0  # a definition of the bag's own that goes without


def _seconds(value: float) -> float:
    return value if 0.0 <= value < math.inf else 0.0
