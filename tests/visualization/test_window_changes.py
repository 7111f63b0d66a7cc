"""What a person sees of the window while it changes: whole pictures only, and its end at once."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.patience import PATIENCE_S
from tests.visualization.test_window import Display, children, display, pytestmark, window
from trocar.services.visualization import window as window_module
from trocar.services.visualization.window import WindowOutput

__all__ = ["display", "pytestmark", "window"]

_DRAW = """
import json
from types import SimpleNamespace
from trocar.services.visualization import codec
from trocar.services.visualization.render_governor import RUNGS
from trocar.services.visualization.render_pipe import FRAME, HELLO, NOTICE
from trocar.services.visualization.window_worker import NativeWindow
from tests.visualization.test_window import a_scene

window, drawn, seen = NativeWindow(), [], {}
size = window._renderer.plotter.render_window.GetSize
window._renderer.plotter.render_window.AddObserver("EndEvent", lambda *_: drawn.append(size()))
layout, picture = a_scene()
window._governor.drawn = lambda *_: False
window.take_message(HELLO, codec.encode_hello(layout).encode())
began = window._governor.rung
for rung in (began, began, len(RUNGS) - 1, 0):
    drawn.clear()
    window._governor = SimpleNamespace(rung=rung, rate_hz=0.0, drawn=lambda *_: False)
    window._take_rung()
    window.take_message(FRAME, codec.encode(picture, 0))
    window.draw()
    seen[f"{len(seen)}: rung {rung}"] = len(drawn)
window._governor = SimpleNamespace(rung=len(RUNGS) - 1, rate_hz=0.0, drawn=lambda *_: True)
before = size()
window.draw()
while_it_starts = size()
window.take_message(NOTICE, json.dumps({"state": "armed", "reason": "", "safe_stop": False}).encode())
window.draw()
print(json.dumps({"drawn": seen, "before": before, "starting": while_it_starts, "after": size(), "last": drawn[-1]}))
"""


def test_each_picture_is_drawn_once_and_nothing_before_it_is_whole(display: Display) -> None:
    """A library that draws for every actor that comes shows a duct without its tools, on a busy machine for seconds."""
    command = [sys.executable, "-c", _DRAW]
    root = Path(__file__).parents[2]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=True, cwd=root)
    seen = json.loads(done.stdout)
    assert len(seen["drawn"]) == 4
    assert set(seen["drawn"].values()) == {1}, seen
    assert seen["before"] == seen["starting"], "how long a picture takes says nothing while the rig starts"
    assert seen["before"] != seen["after"], "a coarser rung is a smaller window"
    assert seen["last"] == seen["after"], "which does not wait for the next picture to show one"


def test_one_that_has_ended_is_not_killed() -> None:
    """Nobody heard of the error: the window's task was over."""

    async def end() -> int | None:
        worker = await asyncio.create_subprocess_exec("true", stdin=asyncio.subprocess.PIPE)
        while worker.returncode is None:
            await asyncio.sleep(0.01)
        await window_module._end(worker, 0.0)
        return worker.returncode

    assert asyncio.run(end()) == 0


@pytest.mark.timeout(PATIENCE_S)
def test_a_window_that_was_closed_is_not_waited_for(window: WindowOutput, monkeypatch: pytest.MonkeyPatch) -> None:
    """A driver may take long to end: who waits for it says nothing, is taken for hung, and started again."""
    monkeypatch.setattr(window_module, "_END_S", 10.0 * PATIENCE_S)
    (worker,) = children()
    os.kill(worker, signal.SIGSTOP)
    window.closed = True
    window.close()
    assert not Path(f"/proc/{worker}").exists()
    window.close = lambda: None  # type: ignore[method-assign]  # the fixture's
