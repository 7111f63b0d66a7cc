"""The window shows whole pictures only: what is built anew for another rung is not seen piece by piece."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from tests.visualization.test_window import PATIENCE_S, Display, display, pytestmark

__all__ = ["display", "pytestmark"]

_DRAW = """
import json
from services.visualization import codec
from services.visualization.pace import RUNGS
from services.visualization.render_pipe import FRAME, HELLO
from services.visualization.window_worker import Window
from tests.visualization.test_window import a_scene

window, drawn, seen = Window(), [], {}
window._renderer.plotter.render_window.AddObserver("EndEvent", lambda *_: drawn.append(None))
layout, picture = a_scene()
window.take(HELLO, codec.encode_hello(layout).encode())
for rung in (window._pace.rung, window._pace.rung, len(RUNGS) - 1, 0):
    drawn.clear()
    window._pace.rung = rung
    window._take_rung()
    window.take(FRAME, codec.encode(picture, 0))
    window.draw()
    seen[f"{len(seen)}: rung {rung}"] = len(drawn)
print(json.dumps(seen))
"""


def test_each_picture_is_drawn_once_and_nothing_before_it_is_whole(display: Display) -> None:
    """A library that draws for every actor that comes shows a duct without its tools, on a busy machine for seconds."""
    command = [sys.executable, "-c", _DRAW]
    root = Path(__file__).parents[2]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=True, cwd=root)
    seen = json.loads(done.stdout)
    assert len(seen) == 4
    assert set(seen.values()) == {1}, seen
