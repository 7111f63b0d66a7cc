"""The native window on a virtual display: nothing waits for it, and its end is told.

One window is seen first, stands still, loses its display, and is closed.
"""

import logging
import os
import select
import shutil
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from tests.autogroups import may_be_set
from tests.patience import PATIENCE_S
from tests.virtual_display import VirtualDisplay
from trocar.services.mechanics.scene import ForcepsScene
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct
from trocar.services.runtime.errors import DeviceError
from trocar.services.runtime.measures.histogram import LatencyHistogram
from trocar.services.runtime.process.health import LatencyPath
from trocar.services.visualization import tool_pose
from trocar.services.visualization import window as window_output
from trocar.services.visualization.picture import Picture, PictureLayout, ToolShape
from trocar.services.visualization.window import WindowOutput

_MISSING = [name for name in ("Xvfb", "xdotool") if shutil.which(name) is None]
pytestmark = [
    pytest.mark.skipif(find_spec("pyvista") is None, reason="pyvista is not installed (extra `view`)"),
    pytest.mark.skipif(bool(_MISSING), reason=f"not here: {', '.join(_MISSING)} (apt-get install xvfb xdotool)"),
]
NOTICE = '{"type": "rig", "state": "running", "reason": "", "safe_stop": false}'
#: Numbers of displays, beyond those that a person or a search for a free one takes; X allows 59,536.
_FIRST_DISPLAY, _DISPLAYS = 1_000, 50_000


class Display:
    """A virtual screen whose memory can be looked into.

    Its number comes from this process's own: servers that look for a free one remove each other's sockets where two
    start at once, and one that was ended would find its number taken when it comes back.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.name = f":{_FIRST_DISPLAY + os.getpid() % _DISPLAYS}"
        self.start()

    def start(self) -> None:
        """Start it; it serves when this returns."""
        self._server = VirtualDisplay(self.name, ["-fbdir", str(self.folder)])

    def end(self) -> None:
        """End it as its user would."""
        self._server.end()

    def pixels(self) -> np.ndarray:
        """Return the screen (height, width, 3), from the server's own memory (an XWD file)."""
        data = (self.folder / "Xvfb_screen0").read_bytes()
        words = struct.unpack(">25I", data[:100])
        start, width, height, line = words[0] + 12 * words[19], words[4], words[5], words[12]  # of an XWDFileHeader
        rows = np.frombuffer(data, np.uint8, line * height, start).reshape(height, line)[:, : 4 * width]
        return rows.reshape(height, width, 4)[..., 2::-1].astype(float)

    def window(self) -> np.ndarray:
        """Return what is seen of the window, whose place is the screen's corner."""
        geometry = self._xdotool("search", "--name", "Trocar", "getwindowgeometry", "--shell")
        words = dict(line.split("=") for line in geometry.split())
        return self.pixels()[: int(words["HEIGHT"]), : int(words["WIDTH"])]

    def press(self, key: str) -> None:
        """Press a key over the window."""
        self._xdotool("mousemove", "100", "100", "key", key)

    def _xdotool(self, *words: str) -> str:
        environment = {**os.environ, "DISPLAY": self.name}
        return subprocess.run(["xdotool", *words], env=environment, check=True, capture_output=True, text=True).stdout


@pytest.fixture(scope="module")
def display(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Display]:
    found = Display(tmp_path_factory.mktemp("display"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DISPLAY", found.name)
        try:
            yield found
        finally:
            found.end()


@pytest.fixture(scope="module")
def window(display: Display) -> Iterator[WindowOutput]:
    output = open_window()
    try:
        yield output
    finally:
        output.close()


def open_window() -> WindowOutput:
    """Open one, as patiently as a test is."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(window_output, "_OPEN_S", PATIENCE_S)
        return WindowOutput(LatencyPath(LatencyHistogram(33_000_000)), logging.getLogger("trocar.window"))


def a_scene() -> tuple[PictureLayout, Picture]:
    """A duct with the catheter on its way in, a forceps at each of them."""
    mesh = parametric_duct(DuctGeometry(radius_m=4e-3, length_m=40e-3, n_around=16, n_along=20))
    rest = mesh.vertices_m.astype(np.float32)
    parts = ForcepsScene(jaw_radius_m=1.2e-3).drawn()
    tools = tuple(ToolShape(name, port, 2.5e-3, parts, 18e-3, 1.2e-3) for name, port in PORTS.items())
    mouth, held = (tuple(int(i) for i in mesh.vertex_sets[name]) for name in ("mouth", "clamped"))
    layout = PictureLayout(1, "test", rest, mesh.triangles, 6e-4, mouth, held, 40, 1e-3, tools)
    line = np.linspace(CATHETER_END_M, [0.03, 0.0, 0.0], 40).astype(np.float32)
    poses = [[*at, *tool_pose.orientation(np.array(at), PORTS[name], 0.3)] for name, at in JUNCTIONS.items()]
    force_n = np.array([[0.0, 0.0, 0.4], [0.1, 0.0, 0.2]], np.float32)
    return layout, Picture(
        1, 1, 0, 0, rest, line, np.array(poses, np.float32), np.array([0.5, 0.7], np.float32), force_n
    )


PORTS = {"left": (0.075, -0.060, 0.120), "right": (0.010, 0.070, 0.110)}
JUNCTIONS = {"left": (0.058, -0.004, 0.014), "right": (0.026, 0.008, 0.012)}
CATHETER_END_M = [0.11, 0.0, 0.01]


def until(output: WindowOutput, condition: Callable[[], bool], picture: Picture, layout: PictureLayout) -> int:
    """Show pictures until something holds; return how many were."""
    deadline_s, shown = time.monotonic() + PATIENCE_S, 0
    while not condition():
        assert time.monotonic() < deadline_s, "it did not happen"
        shown += 1
        output.show(layout, replace(picture, sequence=shown, tick=shown), NOTICE)
        output.wait_until(time.monotonic_ns() + 20_000_000)
    return shown


def test_who_draws_comes_after_the_view_once_it_is_seen_and_not_after_everybody(
    window: WindowOutput, display: Display
) -> None:
    (worker,) = children()
    ours = os.getpriority(os.PRIO_PROCESS, 0)
    asked = max(5, ours)
    assert os.getpriority(os.PRIO_PROCESS, worker) == ours
    layout, picture = a_scene()
    until(window, lambda: window.gauges()["window_pictures"] > 0, picture, layout)
    threads = [int(task.name) for task in Path(f"/proc/{worker}/task").iterdir()]
    assert min(os.getpriority(os.PRIO_PROCESS, thread) for thread in threads) == asked
    assert os.getsid(worker) == worker, "its niceness counts beside other sessions, not beside its parent only"
    group = Path(f"/proc/{worker}/autogroup")
    if may_be_set():
        assert group.read_text().split()[-1] == str(asked)


def test_a_window_that_stands_still_holds_up_nobody(window: WindowOutput, display: Display) -> None:
    layout, picture = a_scene()
    until(window, lambda: window.gauges()["window_pictures"] > 0, picture, layout)
    (worker,) = children()
    os.kill(worker, signal.SIGSTOP)
    drawn = window.gauges()["window_pictures"]
    for sequence in range(1000, 1400):  # more than any pipe holds
        window.show(layout, replace(picture, sequence=sequence), NOTICE)
        window.wait_until(time.monotonic_ns() + 1_000_000)
    assert window.gauges()["window_pictures"] <= drawn + 2
    os.kill(worker, signal.SIGCONT)
    until(window, lambda: window.gauges()["window_pictures"] > drawn + 3, picture, layout)


def children() -> list[int]:
    """Return the processes of this one that draw."""
    found = subprocess.run(
        ["pgrep", "-P", str(os.getpid()), "-f", "window_worker"], capture_output=True, text=True, check=True
    )
    return [int(word) for word in found.stdout.split()]


def test_a_display_that_goes_away_is_one_sentence_and_the_window_comes_back_with_it(
    window: WindowOutput, display: Display, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(window_output, "_RETRY_S", 0.5)
    layout, picture = a_scene()
    until(window, lambda: window.gauges()["window_pictures"] > 0, picture, layout)
    display.end()
    until(window, lambda: not window.gauges()["window_open"], picture, layout)
    (record,) = caplog.records
    assert f"the window on display {display.name} ended" in record.message
    assert "the rig goes on without a picture" in record.message
    display.start()
    drawn = window.gauges()["window_pictures"]
    until(window, lambda: window.gauges()["window_pictures"] > drawn, picture, layout)
    assert len(caplog.records) == 1
    assert not window.closed


def test_closing_the_window_is_told(window: WindowOutput, display: Display) -> None:
    layout, picture = a_scene()
    until(window, lambda: window.gauges()["window_pictures"] > 0, picture, layout)
    display.press("q")
    until(window, lambda: window.closed, picture, layout)


def test_a_thread_that_is_nicer_by_itself_stays_so() -> None:
    """An ordinary user could not make it less nice, and the window would end over it."""
    code = """if True:
        import os, sys, threading
        from unittest.mock import Mock
        sys.modules["trocar.services.visualization.render"] = Mock()  # what draws takes a second to import
        sys.modules["trocar.services.visualization.overlay"] = Mock()
        from trocar.services.visualization.window_worker import _come_after
        asked, is_nice, end = max(7, os.nice(0)), threading.Event(), threading.Event()
        def be_nice():
            os.setpriority(os.PRIO_PROCESS, 0, 19)
            is_nice.set()
            end.wait()
        other = threading.Thread(target=be_nice)
        other.start()
        is_nice.wait()
        _come_after(asked)
        print(asked, *(os.getpriority(os.PRIO_PROCESS, n) for n in (os.getpid(), other.native_id)))
        end.set()
    """
    ran = subprocess.run(
        [sys.executable, "-c", code], start_new_session=True, check=True, capture_output=True, text=True
    )
    asked, main, nicer = map(int, ran.stdout.split())
    assert (main, nicer) == (asked, 19)


def test_a_window_that_stands_still_goes_with_the_view(display: Display) -> None:
    """It is in no group of the view's, and does not see its pipe end."""
    code = (
        "import time; from tests.visualization.test_window import children, open_window;"
        "window = open_window(); print(*children(), flush=True); time.sleep(600)"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as view:
        assert view.stdout is not None
        worker = int(view.stdout.readline())
        os.kill(worker, signal.SIGSTOP)
        descriptor = os.pidfd_open(worker)
        view.kill()
    ended = bool(select.select([descriptor], [], [], PATIENCE_S)[0])
    if not ended:
        signal.pidfd_send_signal(descriptor, signal.SIGKILL)
    os.close(descriptor)
    assert ended, "it lives on without anybody"


def test_a_choice_of_drawing_off_the_screen_is_not_a_missing_display(
    display: Display, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    monkeypatch.setenv("DISPLAY", display.name)
    output = open_window()
    try:
        assert output.gauges()["window_open"] == 1.0
    finally:
        output.close()


def test_a_display_that_is_not_there_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DISPLAY", ":4711")
    monkeypatch.setattr(window_output, "_TRIES", 2)
    with pytest.raises(DeviceError, match=r"visualization\.viewer: the window on display :4711 ended .*is not there"):
        open_window()


def test_a_display_that_refuses_the_first_window_gets_a_second(
    display: Display, monkeypatch: pytest.MonkeyPatch
) -> None:
    real, begun = WindowOutput._show_once, []

    async def refused_once(self: WindowOutput) -> int:
        begun.append(self)
        return await real(self) if len(begun) > 1 else 1

    monkeypatch.setattr(WindowOutput, "_show_once", refused_once)
    output = open_window()
    try:
        assert output.gauges()["window_open"] == 1.0
        assert len(begun) == 2
    finally:
        output.close()
