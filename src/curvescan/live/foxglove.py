"""FoxgloveSink: a live run as the node's ROS 2 messages on a websocket (extra ``curvescan[foxglove]``)."""

from collections.abc import Callable
from typing import Any, Unpack

from curvescan.errors import CurvescanError, MissingPackageError, OutputError
from curvescan.io.ros.writing.message_building import MessageBuilder
from curvescan.live.recorder import MAP_TOPIC, TOPICS, MessageSink
from curvescan.live.server import local_url
from curvescan.live.sinks import MapOptions
from curvescan.live.tracker import Pace

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
        self._is_finished = False
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
        super().__init__("foxglove", builder, Pace(2.0, 0.1), **options)

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
