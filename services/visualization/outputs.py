"""Where pictures go: to browsers, to a window of this host, or nowhere."""

from __future__ import annotations

import logging
import time

from services.runtime.errors import UserError
from services.runtime.health import LatencyPath
from services.runtime.loop import sleep_until
from services.runtime.rig import ViewSettings
from services.visualization import codec
from services.visualization.camera_feed import CameraFeed
from services.visualization.display import display_name, record
from services.visualization.feed import FeedMessage, Feeds
from services.visualization.page_hands import PageHands
from services.visualization.picture import Picture, PictureLayout


class Output:
    """A place where pictures go; by itself nowhere: what a headless run without a page costs.

    Attributes:
        closed: bool. Whether a person has closed it.
    """

    def __init__(self, painted: LatencyPath) -> None:
        self.closed = False
        self._painted = painted
        self._layout: PictureLayout | None = None
        self._hello = ""

    def _message(self, layout: PictureLayout, picture: Picture) -> FeedMessage:
        """Return the picture as it is sent."""
        if layout is not self._layout:
            self._layout, self._hello = layout, codec.encode_hello(layout)
        data = codec.encode(picture, time.monotonic_ns())
        return FeedMessage(picture.epoch, self._hello, picture.sequence, picture.origin_ns, data)

    def show(self, layout: PictureLayout, picture: Picture, notice: str) -> None:
        """Show the newest picture; `notice` is the text message that tells the state of the rig."""
        record(self._painted, picture)

    def wait_until(self, deadline_ns: int) -> None:
        """Do what must be done between pictures; return at `deadline_ns`."""
        sleep_until(deadline_ns)

    def wanted_hz(self) -> float | None:
        """Return how many pictures a second whoever looks can take; None: all."""
        return None

    def gauges(self) -> dict[str, float]:
        """Return figures for the health report."""
        return {}

    def close(self) -> None:
        """Give everything up."""


class WebOutput(Output):
    """Streams pictures to browsers, which draw them.

    Raises UserError if the view's port is taken, or the web packages are not installed.
    """

    def __init__(self, settings: ViewSettings, painted: LatencyPath, log: logging.Logger, hands: PageHands) -> None:
        super().__init__(painted)
        self._hands = hands
        self._feeds = Feeds(painted)
        self._camera = CameraFeed()
        try:
            from services.visualization.server import ViewServer
        except ImportError as error:
            raise UserError(f"visualization.viewer: web needs starlette (pip install trocar[web]): {error}") from None
        self._server = ViewServer(settings, self._feeds, self._camera, hands)
        self._bytes = 0
        log.info("view on ws://%s:%d/ws", settings.host, self._server.port)

    def show(self, layout: PictureLayout, picture: Picture, notice: str) -> None:
        """Hand the picture to every client; without one, sending is where the path ends."""
        self._feeds.tell(notice)
        message = self._message(layout, picture)
        self._bytes = len(message.data)
        self._camera.offer(message)
        if len(self._feeds):
            self._feeds.offer(message)
        else:
            record(self._painted, picture)

    def wait_until(self, deadline_ns: int) -> None:
        """Serve."""
        self._server.run_until(deadline_ns)

    def wanted_hz(self) -> float | None:
        """Return what the fastest browser can take."""
        return self._feeds.wanted_hz()

    def gauges(self) -> dict[str, float]:
        """Return where the view is served, clients and bytes of a frame."""
        return {
            "view_port": float(self._server.port),
            "clients": float(len(self._feeds)),
            "frame_bytes": float(self._bytes),
            "hands_refused": float(self._hands.refused),
        }

    def close(self) -> None:
        """Stop serving."""
        self._server.close()


def open_output(settings: ViewSettings, painted: LatencyPath, log: logging.Logger, hands: PageHands) -> Output:
    """Return the output that the rig file's ``visualization.viewer`` asks for.

    Raises UserError if a window is asked for where there is no display, or the view's port is taken.
    """
    viewer = settings.viewer
    if viewer == "auto":
        viewer = "native" if display_name() else "web"
    if viewer == "none":
        return Output(painted)
    if viewer == "web":
        return WebOutput(settings, painted, log, hands)
    from services.visualization.window import WindowOutput

    return WindowOutput(painted, log)
