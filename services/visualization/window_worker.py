"""The window's drawing process: reads view messages on stdin, answers on stdout with each drawn picture.

Opening a window, its first frames and a slow driver delay no other process, and the loss of the display ends only this
one. It leads a session, so that the kernel's automatic group has the niceness of this process, which otherwise would
only count relative to its parent.
"""

from __future__ import annotations

import trocar.services.start.entry  # noqa: F401  first: the environment of a process

# isort: split
import contextlib
import json
import os
import select
import sys
import time

from trocar.services.runtime.errors import UserError
from trocar.services.runtime.realtime.autogroup import end_with_parent, set_group_niceness
from trocar.services.runtime.realtime.scheduling import own_threads
from trocar.services.visualization import cameras, codec
from trocar.services.visualization.display import display_name
from trocar.services.visualization.overlay import Overlay
from trocar.services.visualization.picture import Picture, PictureLayout
from trocar.services.visualization.render import Renderer
from trocar.services.visualization.render_governor import RUNGS, RenderGovernor
from trocar.services.visualization.render_pipe import (
    CLOSED,
    FRAME,
    HELLO,
    NOTICE,
    OPEN,
    PAINTED,
    READ_BYTES,
    Splitter,
    pack,
)

_SIZE = (1280, 720)  # HD; a person may enlarge it, and the governor draws fewer pixels where it must, as in software
#: A key or a mouse is heard within less than a picture at 60 Hz; figures that change faster than four times a second
#: are not read.
_EVENTS_EVERY_S, _TELL_EVERY_S = 0.01, 0.25
#: Niceness after the first picture: after the rest of the rig, but not after everything on the machine, as 19 would get
#: only a 68th of another computing process.
_NICENESS = 5


class NativeWindow:
    """The window, which shows the newest message of the pipe."""

    def __init__(self) -> None:
        try:
            self._renderer = Renderer(off_screen=False, size=_SIZE)
        except UserError as error:
            sys.exit(str(error))
        plotter = self._renderer.plotter
        if "EGL" in plotter.render_window.GetClassName():  # used by VTK without a display
            sys.exit(f"no display {display_name()}")
        plotter.show(auto_close=False, interactive_update=True)
        plotter.render_window.SetFrameBlitModeToBlitToCurrent()  # a copy through a texture takes 4 ms
        plotter.suppress_rendering = True  # pyvista would draw after every added actor
        self._governor = RenderGovernor(software=self._renderer.is_software())
        self._overlay = Overlay(plotter)
        self._interactor = plotter.iren.interactor
        self.closed = False
        self._rig_starts = True  # which takes the processor, so that times of pictures mean nothing
        self._own_size = _SIZE
        self._layout: PictureLayout | None = None
        self._shown: Picture | None = None
        self._told_s = 0.0
        self._bind()
        self._take_rung()

    def take_message(self, kind: bytes, data: bytes) -> int | None:
        """Process a message; return the sequence of a picture to be drawn."""
        if kind == HELLO:
            self._layout = codec.decode_hello(data.decode())
        elif kind == NOTICE:
            notice = json.loads(data)
            self._rig_starts = notice["state"] in ("unknown", "off", "starting")
            self._overlay.tell_rig(notice["state"], notice["reason"], safe_stop=notice["safe_stop"])
        elif kind == FRAME and self._layout is not None:
            self._shown = codec.decode(data, self._layout)[0]
            return self._shown.sequence
        return None

    def draw(self) -> None:
        """Draw the newest picture."""
        began_s = time.monotonic()
        if self._layout is not None and self._shown is not None:
            self._renderer.update(self._layout, self._shown)
            if began_s - self._told_s > _TELL_EVERY_S:
                self._told_s = began_s
                self._overlay.tell(self._layout, self._shown, self._governor.rate_hz)
        self._overlay.follow_size()
        self._renderer.draw()
        now_s = time.monotonic()
        if not self._rig_starts and self._governor.drawn(now_s, now_s - began_s):
            self._take_rung()
            self._overlay.follow_size()
            self._renderer.draw()  # a resized window is empty, and the next picture may take long

    def answer_events(self) -> None:
        """Process mouse, keyboard and close events."""
        self._renderer.plotter.iren.process_events()
        self.closed = self.closed or bool(self._interactor.GetDone())

    def close(self) -> None:
        """Close the window."""
        self._renderer.close()

    def _take_rung(self) -> None:
        rung = RUNGS[self._governor.rung]
        self._renderer.take_effects(rung.effects)
        window = self._renderer.plotter.render_window
        size = (round(rung.scale * _SIZE[0]), round(rung.scale * _SIZE[1]))
        if tuple(window.GetSize()) != size and not self._was_resized:
            window.SetSize(*size)
            self._own_size = size

    @property
    def _was_resized(self) -> bool:
        """Whether a person has resized the window, whose size is then kept."""
        return tuple(self._renderer.plotter.render_window.GetSize()) != self._own_size

    def _bind(self) -> None:
        self._renderer.plotter.enable_terrain_style(mouse_wheel_zooms=True)
        self._interactor.RemoveObservers("CharEvent")  # VTK's own keys: wireframe, stereo, picking
        self._interactor.RemoveObservers("KeyPressEvent")
        self._interactor.AddObserver("KeyPressEvent", lambda *_: self._pressed(self._interactor.GetKeySym() or ""))

    def _pressed(self, key: str) -> None:
        key = key.lower().removeprefix("kp_")
        if key.isdigit() and 1 <= int(key) <= len(cameras.PRESETS):
            self._renderer.look_from(cameras.PRESETS[int(key) - 1])
        elif key == "m":
            self._renderer.mirror()
        elif key == "f":
            self._renderer.show_forces = not self._renderer.show_forces
        elif key == "a":
            self._renderer.show_aim = not self._renderer.show_aim
        elif key == "s":
            self._overlay.shows_scales = self._renderer.show_strain = not self._renderer.show_strain
        elif key == "l":
            self._overlay.shows_lens = not self._overlay.shows_lens
        elif key == "h":
            self._overlay.shows_help = not self._overlay.shows_help
        elif key == "q":
            self.closed = True


def main() -> int:
    """Show pictures until the pipe ends or the window is closed."""
    end_with_parent()
    set_group_niceness(os.nice(0))  # the parent's until the first picture, for which a person waits
    window, splitter = NativeWindow(), Splitter()
    _answer(pack(OPEN, b""))
    is_seen = False
    while not window.closed:
        sequence = None
        if select.select([sys.stdin], [], [], _EVENTS_EVERY_S)[0]:
            data = os.read(sys.stdin.fileno(), READ_BYTES)
            if not data:
                window.close()
                return 0
            for kind, body in splitter.feed(data):
                taken = window.take_message(kind, body)
                sequence = sequence if taken is None else taken
        if sequence is not None:
            window.draw()
            if not is_seen:
                is_seen = True
                _come_after(max(_NICENESS, os.nice(0)))
            _answer(pack(PAINTED, sequence.to_bytes(8, "little")))
        window.answer_events()
    _answer(pack(CLOSED, b""))
    return 0


def _come_after(niceness: int) -> None:
    """Set a niceness for this process, the threads of the software renderer and the group of this session.

    A thread with a higher niceness of its own, such as Mesa's for its shader cache, keeps it, as users cannot lower it.
    """
    for thread in own_threads():
        with contextlib.suppress(ProcessLookupError):  # it has ended
            if os.getpriority(os.PRIO_PROCESS, thread) < niceness:
                os.setpriority(os.PRIO_PROCESS, thread, niceness)
    set_group_niceness(niceness)


def _answer(data: bytes) -> None:
    os.write(sys.stdout.fileno(), data)


if __name__ == "__main__":
    sys.exit(main())
