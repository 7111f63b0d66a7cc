"""The page with a school and no rig: the page's own server, a view that shows one picture, made-up attempts."""

from __future__ import annotations

import gzip
import shutil
import socket
import struct
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import uvicorn

from tests.chromium import Chromium
from tests.page.test_picture import still
from tests.patience import PATIENCE_S
from tests.review.benches import made_up
from tests.review.class_of_pages import served
from tests.supervisor import made_up as supervisor
from tests.visualization.test_view_server import Show
from trocar.protocol import bodies
from trocar.review.attempts.assessment import Assessment, Series
from trocar.review.school.app import build_app as build_school
from trocar.review.school.bench import Bench
from trocar.review.school.settings_routes import EditableSettings
from trocar.review.settings.files import ConfigurationFiles
from trocar.review.settings.host import Host
from trocar.services.runtime.config.config import config_directory, load_rig
from trocar.services.supervisor.page.school import socket_path
from trocar.services.supervisor.page.web import PageContext, build_app
from trocar.services.training.errors import ErrorEvent
from trocar.services.training.score import Score
from trocar.services.visualization import codec

TOKEN = "of this session 7"
_TICK = 40


@dataclass
class SchoolPage:
    """A browser on the page, what the page is told, and the school behind it."""

    browser: Chromium
    context: PageContext
    bench: Bench
    address: str
    asked: list[Any] = field(default_factory=list)
    _body: dict[str, Any] = field(default_factory=dict)

    def tell(self, **attempt: Any) -> None:
        """Let the rig tell of an attempt."""
        base: dict[str, Any] = {
            "begins": 0, "attempt_id": "20261130T0-a", "state": "armed", "scenario": "basic", "simulated_time": True,
            "title": "Slide the catheter into the duct", "time_limit_s": 300.0, "goal_depth_m": 0.01,
            "depth_max_m": 0.02, "force_limit_n": 2.6, "held": ("catheter", ""), "began_tick": 0,
            "hint": "Grasp the catheter, lead its tip into the duct, and push it on to the first marker.",
        }  # fmt: skip
        told = bodies.Attempt(**{**base, **attempt})
        self.context.latest = msgspec.json.encode({**self._body, "attempt": msgspec.structs.asdict(told)})

    def press(self, selector: str) -> None:
        """Click with the mouse in the middle of an element, once it is seen."""
        self.browser.until(lambda: self.sees(selector), PATIENCE_S, f"{selector} is seen")
        box = self.browser.evaluate(f"document.querySelector({selector!r}).getBoundingClientRect().toJSON()")
        at = {"x": box["x"] + 0.5 * box["width"], "y": box["y"] + 0.5 * box["height"]}
        for kind, down in (("mousePressed", 1), ("mouseReleased", 0)):
            self.browser.command("Input.dispatchMouseEvent", type=kind, button="left", clickCount=1, buttons=down, **at)

    def sees(self, selector: str) -> bool:
        """Return whether an element is shown."""
        script = f"document.querySelector({selector!r})?.getClientRects().length > 0"
        return bool(self.browser.evaluate(script))

    def until(self, expression: str, what: str, seconds: float = PATIENCE_S) -> None:
        """Wait until a JavaScript expression is true."""
        self.browser.until(lambda: self.browser.evaluate(expression), seconds, what)


def assessed(name: str, *errors: ErrorEvent, total: float = 220.0, **given: Any) -> Assessment:
    """Return an attempt of 20 s with curves, forces and errors."""
    times = [0.1 * k for k in range(200)]
    series = Series(
        time_s=times,
        inserted_mm=[max(0.0, t - 8.0) for t in times],
        loads_n={"left": [abs(float(np.sin(t))) for t in times], "right": [0.3 for _ in times]},
    )
    score = Score(total=total, time_saved_s=280.0, penalties_s=280.0 - total)
    return msgspec.structs.replace(
        made_up(name), title="Slide the catheter into the duct", errors=list(errors), score=score, from_tick=0,
        limits={"tool_duct": 2.6, "tool_catheter": 2.0, "catheter_wall": 0.5}, series=series, goal_depth_m=0.01,
        depth_max_m=0.02, began_ns=time.monotonic_ns(), **given,
    )  # fmt: skip


def replay(n_frames: int = 50) -> bytes:
    """Return the file of a replay: what a page would have kept."""
    layout, picture = still()
    hello = codec.encode_hello(layout).encode()
    parts = [struct.pack("<I", len(hello)), hello]
    for k in range(n_frames):
        picture.tick = 10 * _TICK * k
        frame = codec.encode(picture, 0)
        parts += [struct.pack("<I", len(frame)), frame]
    return gzip.compress(b"".join(parts))


@contextmanager
def school_page(folder: Path, size: tuple[int, int] = (1280, 800)) -> Iterator[SchoolPage]:
    """Serve the page with a school; yield it in a browser with a new profile."""
    with ExitStack() as stack:
        show = stack.enter_context(Show(0.2))
        show.layout, show.picture = still()
        bench = Bench(str(folder / "a.sqlite"))
        places = (f"transport.directory={folder / 'bus'}", f"recorder.directory={folder / 'recordings'}")
        settings = load_rig("mouse", places)
        context = PageContext(
            rig=settings, scene="default", registries={}, ask=lambda _: bodies.Answer(order=0, ok=True, text="done"),
            healthy=lambda: (True, "running"), view_port=lambda: show.port, token=TOKEN, switches=True,
        )  # fmt: skip
        body = msgspec.to_builtins(supervisor.shown(supervisor.Bench(supervisor.rig())))
        of_rig = EditableSettings(ConfigurationFiles(_copied(folder)), Host(settings, ("mouse", ()), "default"))
        stack.enter_context(_listening(build_school(bench, of_rig), socket_path(settings.transport)))
        [address] = stack.enter_context(served(build_app(context)))
        browser = stack.enter_context(Chromium(folder / "profile", size))
        page = SchoolPage(browser, context, bench, address, _body={**body, "state": "running", "safe_stop": False})

        def ask(command: Any) -> bodies.Answer:
            page.asked.append(command)
            return bodies.Answer(order=0, ok=True, text="a new attempt begins")

        context.ask = ask
        page.tell()
        yield page


def _copied(folder: Path) -> Path:
    """Return a configuration folder that may be written into."""
    for kind in ("rigs", "scenes", "devices"):
        shutil.copytree(config_directory() / kind, folder / "configs" / kind, dirs_exist_ok=True)
    return folder / "configs"


@contextmanager
def _listening(app: Any, path: Path) -> Iterator[None]:
    """Serve an application at a Unix socket."""
    sock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    sock.bind(str(path))
    sock.listen(8)
    server = uvicorn.Server(uvicorn.Config(app, log_level="error", lifespan="off", ws="none"))
    thread = threading.Thread(target=server.run, kwargs={"sockets": [sock]})
    thread.start()
    try:
        yield
    finally:
        server.should_exit = True
        thread.join()
