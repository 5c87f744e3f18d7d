"""A live run as the node's ROS 2 messages: McapRecorder writes them to a file, FoxgloveSink to a websocket."""

import os
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from curvescan.errors import CurvescanError, MissingPackageError, OutputError
from curvescan.io.files.output import output_file
from curvescan.io.ros.bags.bag_files import BagKind
from curvescan.io.ros.messages import LASER_SCAN, OCCUPANCY_GRID, ODOMETRY, TRANSFORMS
from curvescan.io.ros.writing.bags import ODOM_TOPIC, SCAN_TOPIC, TF_TOPIC, BagWriter, mcap_in_file
from curvescan.io.ros.writing.message_building import LASER_FRAME, MAP_FRAME, ODOM_FRAME, MessageBuilder
from curvescan.live.base_motion import BaseMotion
from curvescan.live.server import local_url
from curvescan.live.sinks import MapOptions, MapSink
from curvescan.live.tracker import Pace, TrackedScan

MAP_TOPIC = "/map"
TOPICS = {SCAN_TOPIC: LASER_SCAN, ODOM_TOPIC: ODOMETRY, TF_TOPIC: TRANSFORMS[0], MAP_TOPIC: OCCUPANCY_GRID}
"""Topics and the types of their messages."""


class MessageSink(MapSink):
    """A sink of messages: scan, odom with its velocity, tf (in a map map -> odom too), and the map at its pace."""

    def __init__(
        self, name: str, builder: MessageBuilder, maps: Pace, *, capacity: int = 200, **options: Unpack[MapOptions]
    ) -> None:
        self._builder, self._maps = builder, maps
        self._is_mapped = options.get("mode", "odometry") != "odometry"
        self._motion = BaseMotion(np.zeros(3))
        self._stamp, self._sent_map = 0.0, -1
        self.n_uneven = 0  # scans that were left out, as their beams are not evenly spaced
        super().__init__(name, capacity=capacity, **options)

    def _send(self, topic: str, message: Any) -> None:
        """Send a message of one of TOPICS."""
        raise NotImplementedError

    def _take(self, tracked: TrackedScan) -> None:
        builder, state = self._builder, self._motion.add(tracked.step, tracked.scan.stamp)
        self._stamp = tracked.scan.stamp
        stamp = self._stamp + tracked.half_sweep  # that the pose is of
        odom, twist = state.odom_base, {"twist": state.twist, "twist_covariance": state.twist_covariance}
        edges = [(ODOM_FRAME, LASER_FRAME, odom.pose)]
        if self._is_mapped and state.map_odom is not None:
            edges.append((MAP_FRAME, ODOM_FRAME, state.map_odom))
        if tracked.scan.has_uniform_angles:  # the message has no room for others
            self._send(SCAN_TOPIC, builder.laser_scan(tracked.scan)[0])
        else:
            self.n_uneven += 1
        self._send(ODOM_TOPIC, builder.odometry(stamp, odom.pose, odom.covariance, **twist))
        self._send(TF_TOPIC, builder.transforms(stamp, edges))
        self._map.add(tracked)
        if self._maps.is_due:
            self._send_map()

    def _send_map(self) -> None:
        """Send the map if it has changed."""
        with self._maps:
            if self._sent_map == self._map.version:
                return
            self._sent_map = self._map.version
            grid = self._map.grid()
            if grid.log_odds.size:
                percent = np.rint(100.0 * grid.probability).astype(np.int8)
                percent[grid.log_odds == 0.0] = -1
                frame, place = MAP_FRAME if self._is_mapped else ODOM_FRAME, (grid.origin, grid.resolution)
                self._send(MAP_TOPIC, self._builder.occupancy_grid(self._stamp, percent, *place, frame))


MAP_PERIOD = 10.0  # the map is written at most every so many seconds, and at the end


class McapRecorder(MessageSink):
    """Writes each scan to /scan, its pose by odometry to /odom and /tf, and the map to /map, in its own thread.

    The file appears whole when the recorder is closed. Ranges are written as float32. Scans whose beams are not evenly
    spaced are left out, and that is reported at the end.
    """

    def __init__(self, path: str | os.PathLike[str], **options: Unpack[MapOptions]) -> None:
        self.path = Path(path)
        self._files = ExitStack()
        try:
            temporary = self._files.enter_context(output_file(self.path))
            folder = self._files.enter_context(mcap_in_file(temporary))
            self._bag = self._files.enter_context(BagWriter(folder, BagKind.MCAP))
        except OSError as error:
            self._files.close()
            raise OutputError(f"cannot write {self.path}: {error}") from error
        self.n_scans = 0
        with Pace(MAP_PERIOD) as maps:  # the first map is written when one has passed
            super().__init__("recorder", self._bag.builder, maps, capacity=1000, **options)

    def _take(self, tracked: TrackedScan) -> None:
        super()._take(tracked)
        self.n_scans += 1

    def _send(self, topic: str, message: Any) -> None:
        self._bag.write(topic, TOPICS[topic], message, self._stamp)

    def _finish(self) -> None:
        try:
            if self.n_scans and self.error is None:
                super()._finish()
                self._send_map()
        except CurvescanError as error:
            self.error = error
        try:
            self._files.close()
        except OSError as error:
            self.error = OutputError(f"cannot write {self.path}: {error}")


DEFAULT_PORT = 8766  # default port; Foxglove's own, 8765, is the page's


class FoxgloveSink(MessageSink):
    """Serves /scan, /odom, /tf and /map to Foxglove in its own thread; a slow client loses the oldest messages.

    `name` is the source's; port 0 is a free one; /map begins with the saved map, and a late client gets it at once.
    """

    def __init__(
        self, name: str, *, host: str = "127.0.0.1", port: int = DEFAULT_PORT, **options: Unpack[MapOptions]
    ) -> None:
        try:
            import foxglove
        except ImportError as error:
            raise MissingPackageError(
                "--foxglove needs the package foxglove-sdk: pip install 'curvescan[foxglove]'"
            ) from error
        builder = MessageBuilder(where="websocket")
        # held: what goes on in a context ends with it
        self._context = context = foxglove.Context()
        self._channels = {
            topic: foxglove.Channel(
                topic,
                schema=foxglove.Schema(name=msgtype, encoding="ros2msg", data=builder.definition(msgtype).encode()),
                message_encoding="cdr",
                context=context,
            )
            for topic, msgtype in TOPICS.items()
        }
        self._is_finished, self._maps = False, Pace(2.0, 0.1)  # a client may want the map at once
        try:
            self._server: Any = foxglove.start_server(
                name=f"curvescan: {name}",
                host=host,
                port=port,
                server_listener=_listener(self._want_map),
                context=context,
            )
        except (RuntimeError, OSError, OverflowError) as error:
            raise OutputError(
                f"cannot serve Foxglove at {host}:{port}: {error}; choose another --foxglove-port or --host"
            ) from error
        self.url = local_url("ws", host, self._server.port)  # where a Foxglove on this machine finds it
        super().__init__("foxglove", builder, self._maps, **options)

    def stop(self) -> None:
        """Close the connections of all clients."""
        self._server.stop()

    def _finish(self) -> None:
        super()._finish()
        self._is_finished = True
        self._want_map()

    def _want_map(self) -> None:
        """Send the map with the next scan; at once when there will be none."""
        self._sent_map = -1
        self._maps.hurry()
        if self._is_finished and self.error is None:
            try:
                self._send_map()
            except CurvescanError as error:
                self.error = error

    def _send(self, topic: str, message: Any) -> None:
        channel = self._channels[topic]
        if channel.has_sinks():
            data = bytes(self._builder.encoded(message, TOPICS[topic]))
            channel.log(data, log_time=max(self._builder.nanoseconds(self._stamp), 0))


def _listener(want_map: Callable[[], None]) -> Any:
    """Return what notices clients that want the map; what they send is not read."""
    from foxglove.websocket import ServerListener

    class Listener(ServerListener):
        def on_subscribe(self, client: Any, channel: Any) -> None:
            if channel.topic == MAP_TOPIC:
                want_map()

    return Listener()
