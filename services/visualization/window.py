"""The picture in a window of this host."""

from __future__ import annotations

import os
import time

from services.runtime.errors import UserError
from services.runtime.health import LatencyPath
from services.runtime.loop import sleep_until
from services.visualization.display import has_display, record
from services.visualization.picture import Layout, Picture

_EVENTS_EVERY_S = 0.004


class WindowOutput:
    """A pyvista window that the trainee's monitor shows; closing it ends the process.

    Raises
    ------
    UserError
        if there is no display, or pyvista is not installed.
    """

    def __init__(self, painted: LatencyPath) -> None:
        if not has_display():
            raise UserError(
                "visualization.viewer: native needs a display, and neither DISPLAY nor WAYLAND_DISPLAY is set"
            )
        try:
            from services.visualization.render import Renderer
        except ImportError as error:
            raise UserError(f"visualization.viewer: native needs pyvista (pip install trocar[view]): {error}") from None
        # Threads of the software renderer would push the loops aside: 4 instead of 1 ms of lateness were measured.
        os.environ.setdefault("LP_NUM_THREADS", "1")
        self.closed = False
        self._painted = painted
        self._renderer = Renderer(off_screen=False, size=(1280, 800))
        self._renderer.plotter.show(auto_close=False, interactive_update=True)
        self._renderer.smooth_edges()

    def show(self, layout: Layout, picture: Picture, notice: str) -> None:
        """Draw the picture."""
        self._renderer.update(layout, picture)
        self._renderer.draw()
        record(self._painted, picture)

    def wait_until(self, deadline_ns: int) -> None:
        """Let the window answer mouse and keyboard."""
        interactor = self._renderer.plotter.iren
        while (spare_s := (deadline_ns - time.monotonic_ns()) * 1e-9) > _EVENTS_EVERY_S:
            interactor.process_events()
            self.closed = self.closed or bool(interactor.interactor.GetDone())
            time.sleep(min(_EVENTS_EVERY_S, max(0.0, spare_s - _EVENTS_EVERY_S)))
        sleep_until(deadline_ns)

    def gauges(self) -> dict[str, float]:
        """Return nothing."""
        return {}

    def close(self) -> None:
        """Close the window."""
        self._renderer.close()
