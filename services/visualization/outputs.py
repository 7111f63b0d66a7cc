"""Outputs of pictures: browsers, a window of this host, or none."""

from __future__ import annotations

import logging
import time

from trocar.services.runtime.config.rig import Rig, ViewSettings
from trocar.services.runtime.errors import MissingPackageError
from trocar.services.runtime.loop.loop import sleep_until
from trocar.services.runtime.process.health import LatencyPath
from trocar.services.runtime.web.web_certificate import Certificate, load_for
from trocar.services.visualization import codec
from trocar.services.visualization.camera_feed import CameraFeed
from trocar.services.visualization.display import display_name, record
from trocar.services.visualization.feed import FeedMessage, Feeds
from trocar.services.visualization.page_hands import PageHands
from trocar.services.visualization.picture import Picture, PictureLayout


class Output:
    """An output of pictures; this base shows none, for headless runs without a page.

    Attributes:
        closed: bool. Whether a person has closed it.
    """

    def __init__(self, painted: LatencyPath) -> None:
        self.closed = False
        self._painted = painted
        self._layout: PictureLayout | None = None
        self._hello = ""

    def _message(self, layout: PictureLayout, picture: Picture) -> FeedMessage:
        """Return the encoded picture."""
        if layout is not self._layout:
            self._layout, self._hello = layout, codec.encode_hello(layout)
        data = codec.encode(picture, time.monotonic_ns())
        return FeedMessage(picture.epoch, self._hello, picture.sequence, picture.origin_ns, data)

    def show(self, layout: PictureLayout, picture: Picture, notice: str) -> None:
        """Show the newest picture; `notice` is the text message on the rig's state."""
        record(self._painted, picture)

    def wait_until(self, deadline_ns: int) -> None:
        """Do the work between pictures; return at `deadline_ns`."""
        sleep_until(deadline_ns)

    def wanted_hz(self) -> float | None:
        """Return the rate of pictures that viewers accept; None for all."""
        return None

    def gauges(self) -> dict[str, float]:
        """Return figures for the health report."""
        return {}

    def close(self) -> None:
        """Release all resources."""


class WebOutput(Output):
    """Streams pictures to browsers, which draw them.

    Raises UserError if the view's port is in use, or the web packages are not installed.
    """

    def __init__(
        self,
        settings: ViewSettings,
        painted: LatencyPath,
        log: logging.Logger,
        hands: PageHands,
        certificate: Certificate | None = None,
    ) -> None:
        super().__init__(painted)
        self._hands = hands
        self._feeds = Feeds(painted)
        self._camera = CameraFeed()
        try:
            from trocar.services.visualization.server import ViewServer
        except ImportError as error:
            raise MissingPackageError("visualization.viewer: web", error.name) from None
        self._server = ViewServer(settings, self._feeds, self._camera, hands, certificate)
        self._bytes = 0
        scheme = "wss" if certificate else "ws"
        log.info("view on %s://%s:%d/ws", scheme, settings.host, self._server.port)

    def show(self, layout: PictureLayout, picture: Picture, notice: str) -> None:
        """Pass the picture to every client; without one, its path ends here."""
        self._feeds.tell(notice)
        message = self._message(layout, picture)
        self._bytes = len(message.data)
        self._camera.offer(message)
        if len(self._feeds):
            self._feeds.offer(message)
        else:
            record(self._painted, picture)

    def wait_until(self, deadline_ns: int) -> None:
        """Serve clients."""
        self._server.run_until(deadline_ns)

    def wanted_hz(self) -> float | None:
        """Return the rate that the fastest browser accepts."""
        return self._feeds.wanted_hz()

    def gauges(self) -> dict[str, float]:
        """Return port, number of clients and bytes of a frame."""
        return {
            "view_port": float(self._server.port),
            "clients": float(len(self._feeds)),
            "frame_bytes": float(self._bytes),
            "hands_refused": float(self._hands.refused),
        }

    def close(self) -> None:
        """Stop serving."""
        self._server.close()


def open_output(rig: Rig, painted: LatencyPath, log: logging.Logger, hands: PageHands) -> Output:
    """Return the output for the rig file's ``visualization.viewer``.

    Raises UserError for a window without a display, if the view's port is in use, or if there is no certificate.
    """
    settings, viewer = rig.visualization, rig.visualization.viewer
    if viewer == "auto":
        viewer = "native" if display_name() else "web"
    if viewer == "none":
        return Output(painted)
    if viewer == "web":
        return WebOutput(settings, painted, log, hands, load_for(rig))
    from trocar.services.visualization.window import WindowOutput

    return WindowOutput(painted, log)
