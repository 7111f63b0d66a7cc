"""The page with a picture and no rig: the built page, served, and a view that shows one picture again and again."""

from __future__ import annotations

import base64
import functools
import http.server
import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.chromium import Chromium
from tests.patience import PATIENCE_S
from tests.visualization.test_view_server import Show
from trocar.services.supervisor.page.page_place import DIST
from trocar.services.visualization.picture import Picture, PictureLayout

SIZE = (1024, 768)
#: As a browser with a graphics processor begins, though the processor draws; half the pixels, few pictures.
_LOOK = """
const {view} = trocar, {governor} = view;
governor.steps = [{ratio: 0.5, look: "wet", shadows: true, hz: 1}];
governor.coarser = governor.finer = () => false;
view.takeStep(0);
"""


@contextmanager
def served(folder: Path, layout: PictureLayout, picture: Picture) -> Iterator[Chromium]:
    """Return a browser on the page that shows the picture; it ends with the block."""
    with Show(0.2) as show, Chromium(folder / "profile", SIZE) as browser:
        show.layout, show.picture = layout, picture
        rig = {
            "name": "still", "scene": "test", "viewer": "web", "view_ws": f"ws://127.0.0.1:{show.port}/ws", "hands": [],
            "contracts": {"loops": {}, "paths": {}}, "scenarios": [],
        }  # fmt: skip
        handler = functools.partial(_WithRig, json.dumps(rig), directory=str(DIST))
        with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
            threading.Thread(target=server.serve_forever, daemon=True).start()
            browser.open(f"http://127.0.0.1:{server.server_port}/")
            browser.until(lambda: browser.evaluate("Boolean(globalThis.trocar?.view?.last)"), PATIENCE_S, "a picture")
            browser.evaluate(f"(() => {{{_LOOK}}})()")
            try:
                yield browser
            finally:
                server.shutdown()


def drawn(browser: Chromium) -> bytes:
    """Return the picture as it is drawn now, as a PNG."""
    url = browser.evaluate("trocar.view.stage.draw(), trocar.view.canvas.toDataURL('image/png')")
    return base64.b64decode(url.partition(",")[2])


class _WithRig(http.server.SimpleHTTPRequestHandler):
    """Serves the page as the supervisor does: with what it is to know of the rig."""

    def __init__(self, rig: str, *arguments: object, **options: object) -> None:
        self._rig = rig
        super().__init__(*arguments, **options)  # type: ignore[arg-type]

    def do_GET(self) -> None:
        if self.path != "/":
            super().do_GET()
            return
        page = (DIST / "index.html").read_text()
        data = page.replace('type="application/json">null<', f'type="application/json">{self._rig}<').encode()
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)

    def log_message(self, *_: object) -> None:
        """Say nothing."""
