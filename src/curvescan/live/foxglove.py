"""FoxgloveSink: a live run as the node's ROS 2 messages on a websocket (extra ``curvescan[foxglove]``)."""

import threading
import time
from collections.abc import Callable
from typing import Any, Unpack

from curvescan.errors import CurvescanError, MissingPackageError, OutputError
from curvescan.io.ros.writing.message_building import MessageBuilder
from curvescan.live.recorder import MAP_TOPIC, TOPICS, LiveMessages
from curvescan.live.server import local_url
from curvescan.live.sinks import MapOptions, MapSink
from curvescan.live.tracker import TrackedScan

DEFAULT_PORT = 8766  # default port; Foxglove's own, 8765, is the page's

_MAP_PERIOD, _MAP_SHARE = 2.0, 0.1
"""The map is sent at most every so many seconds, and in at most this share of the time."""


class FoxgloveSink(MapSink):
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
        self._host = host
        self._builder = MessageBuilder(where="websocket")
        self._messages = LiveMessages(self._builder, is_mapped=options.get("mode", "odometry") != "odometry")
        # held: what goes on in a context ends with it
        self._context = context = foxglove.Context()
        self._channels = {
            topic: foxglove.Channel(
                topic,
                schema=foxglove.Schema(
                    name=msgtype, encoding="ros2msg", data=self._builder.definition(msgtype).encode()
                ),
                message_encoding="cdr",
                context=context,
            )
            for topic, msgtype in TOPICS.items()
        }
        self._sent_map, self._next_map, self._stamp = 0, 0.0, 0.0
        self._is_map_wanted, self._is_finished = threading.Event(), False
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
        super().__init__("foxglove", **options)

    @property
    def url(self) -> str:
        """Where a Foxglove on this machine finds it."""
        return local_url("ws", self._host, self._server.port)

    def stop(self) -> None:
        """Close the connections of all clients."""
        self._server.stop()

    def _take(self, tracked: TrackedScan) -> None:
        self._stamp = tracked.scan.stamp
        for topic, message in self._messages.of_scan(tracked):
            self._send(topic, message)
        self._map.add(tracked)
        if time.monotonic() >= self._next_map or self._is_map_wanted.is_set():
            self._send_map()

    def _finish(self) -> None:
        super()._finish()
        self._is_finished = True
        self._want_map()

    def _want_map(self) -> None:
        """Send the map with the next scan; at once when there will be none."""
        self._is_map_wanted.set()
        if self._is_finished and self.error is None:
            try:
                self._send_map()
            except CurvescanError as error:
                self.error = error

    def _send_map(self) -> None:
        started = time.monotonic()
        if self._sent_map != self._map.version or self._is_map_wanted.is_set():
            self._is_map_wanted.clear()
            self._sent_map = self._map.version
            grid = self._map.grid()
            if grid.log_odds.size:
                self._send(*self._messages.of_map(grid, self._stamp))
        took = time.monotonic() - started
        self._next_map = started + max(_MAP_PERIOD, took / _MAP_SHARE)

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
