"""One thread a rig asks its page once a second; a rig that is slow, silent or mad holds up its own thread and no other.

What a rig answers is read up to a limit, decoded into what is shown and no more, and replaced by the next answer.
"""

from __future__ import annotations

import http.client
import threading
import time
from collections.abc import Callable
from urllib.parse import urlsplit

import msgspec

from trocar.review.classroom.roll import ClassRig
from trocar.services.runtime.errors import UserError
from trocar.services.runtime.web.web_client import open_connection

PERIOD_S = 1.0  # an instructor looks at a class, not at one rig; each look takes a page 10 kB
#: A page that has not answered for so long is shown as silent: what is known of the rig is old.
SILENT_S = 5.0
_PATIENCE_S = 4.0  # less than `SILENT_S`, so that a rig that hangs is shown as silent at once
_STATE_BYTES = 1 << 20  # a hundred times a state, as it may be endless
_PICTURE_BYTES = 8 << 20  # an uncompressed picture of 1920 by 1080 pixels has 6 MB
_PICTURE_S = 40.0  # the rig's renderer may have to start first, which takes up to 30 s
_PNG = b"\x89PNG"
#: A view's own scheme, and that of its pictures.
_SCHEMES = {"ws": "http", "wss": "https"}


class _Loop(msgspec.Struct, frozen=True):
    contract_ok: bool = True


class _Process(msgspec.Struct, frozen=True):
    name: str
    loop: _Loop | None = None


class _Path(msgspec.Struct, frozen=True):
    name: str
    ok: bool = True


class _Attempt(msgspec.Struct, frozen=True):
    state: str = ""
    outcome: str = ""
    title: str = ""
    phase: str = ""
    time_s: float = 0.0
    depth_m: float = 0.0
    goal_depth_m: float = 0.0
    errors: dict[str, int] = {}
    scenario: str = ""
    pace: float = 1.0
    speed: float = 1.0
    counts: bool = True
    practice_only: str = ""
    examined: bool = False


class BenchState(msgspec.Struct, frozen=True):
    """What is taken of a rig's ``/api/state``: the rest is for its own page."""

    state: str = ""
    reason: str = ""
    processes: tuple[_Process, ...] = ()
    paths: tuple[_Path, ...] = ()
    attempt: _Attempt | None = None
    incarnation: int = 0
    t: float = 0.0

    def late(self) -> tuple[str, ...]:
        """Return the loops and paths that do not keep their contracts."""
        loops = [each.name for each in self.processes if each.loop is not None and not each.loop.contract_ok]
        return (*loops, *(each.name for each in self.paths if not each.ok))


class _RigData(msgspec.Struct, frozen=True):
    """What is taken of a rig's ``/api/rig``."""

    view_ws: str


#: Built once: msgspec builds what it knows of a type at the first use, and two threads at once have crashed it.
_STATES = msgspec.json.Decoder(BenchState)
_RIGS = msgspec.json.Decoder(_RigData)


class BenchRow(msgspec.Struct, frozen=True):
    """A rig as the class page shows it; `fault` is why it is not known, `silent_s` for how long."""

    name: str
    address: str
    trainee: str
    state: str
    reason: str
    late: tuple[str, ...]
    attempt: _Attempt | None
    score: float | None
    silent_s: float
    fault: str


class Watch:
    """Follows one rig until it is closed; `last_score` returns the last one that is known of its trainee."""

    def __init__(self, place: ClassRig, last_score: Callable[[str], float | None]) -> None:
        self.place = place
        self._last_score = last_score
        self._state = BenchState()
        self._fault = "has not answered yet"
        self._heard_s: float | None = None
        self._began_s = time.monotonic()
        self._drawing = threading.Lock()
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name=place.name, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Ask no more."""
        self._ending.set()

    def row(self) -> BenchRow:
        """Return what is known now: a rig is silent that was not heard yet, or not for `SILENT_S`."""
        heard_s, state, fault = self._heard_s, self._state, self._fault
        silent_s = time.monotonic() - (self._began_s if heard_s is None else heard_s)
        is_silent = heard_s is None or silent_s > SILENT_S
        if not self._thread.is_alive() and not self._ending.is_set():
            fault = "is not followed any more: a fault of this program, which its terminal shows; start it again"
        return BenchRow(
            self.place.name, self.place.address, self.place.trainee,
            "silent" if is_silent else state.state, state.reason, () if is_silent else state.late(),
            state.attempt, self._last_score(self.place.trainee), silent_s if is_silent else 0.0,
            fault if is_silent else "",
        )  # fmt: skip

    def run_time(self) -> tuple[int, float]:
        """Return the run of the rig that was seen last, and its time now."""
        heard_s = self._heard_s
        since_s = 0.0 if heard_s is None else time.monotonic() - heard_s
        return self._state.incarnation, self._state.t + since_s

    def picture(self) -> bytes:
        """Wait for a picture of the rig and return it as PNG.

        Raises UserError if it has none, or one is being drawn already.
        """
        if not self._drawing.acquire(blocking=False):
            raise UserError("a picture is being drawn already")
        try:
            rig = _RIGS.decode(self._once(self.place.address, "/api/rig", _STATE_BYTES, _PATIENCE_S))
            view = _view_of(self.place.address, rig.view_ws)
            image = self._once(view, "/snapshot.png", _PICTURE_BYTES, _PICTURE_S)
            if not image.startswith(_PNG):
                raise ValueError(f"what is at {view} sends no PNG")
            return image
        except (OSError, http.client.HTTPException, ValueError) as error:
            raise UserError(f"no picture: {error}") from None
        finally:
            self._drawing.release()

    def _run(self) -> None:
        link: http.client.HTTPConnection | None = None
        while True:
            try:
                link = link or self._connection(self.place.address, _PATIENCE_S)
                self._state = _STATES.decode(_get(link, "/api/state", _STATE_BYTES))
                self._heard_s, self._fault = time.monotonic(), ""
            except (OSError, http.client.HTTPException, ValueError) as error:
                self._fault = getattr(error, "strerror", None) or str(error) or type(error).__name__
                if link is not None:
                    link.close()
                link = None
            if self._ending.wait(PERIOD_S):
                break
        if link is not None:
            link.close()

    def _connection(self, address: str, patience_s: float) -> http.client.HTTPConnection:
        return open_connection(address, patience_s, self.place.fingerprint)

    def _once(self, address: str, path: str, most: int, patience_s: float) -> bytes:
        link = self._connection(address, patience_s)
        try:
            return _get(link, path, most)
        finally:
            link.close()


def _view_of(address: str, announced: str) -> str:
    """Return where a rig's picture is: at the rig's own address, at the port that the rig announces as its view's.

    Raises ValueError if it announces none, or another machine's.
    """
    rig, view = urlsplit(address), urlsplit(announced)
    if view.scheme not in _SCHEMES or not view.port:
        raise ValueError("the rig announces none")
    if view.hostname != rig.hostname:
        raise ValueError(f"the rig announces it at another machine: {view.hostname}")
    host = f"[{rig.hostname}]" if ":" in (rig.hostname or "") else rig.hostname
    return f"{_SCHEMES[view.scheme]}://{host}:{view.port}"


def _get(link: http.client.HTTPConnection, path: str, most: int) -> bytes:
    """Return the body of an answer.

    Raises OSError or HTTPException or ValueError if there is none, it is an error, or it is longer than `most` bytes.
    """
    link.request("GET", path)
    answer = link.getresponse()
    body = answer.read(most + 1)
    if len(body) > most or answer.status != 200:
        link.close()
        said = body[:200].decode("utf-8", "replace") if len(body) <= most else f"more than {most} bytes"
        raise ValueError(f"{path}: status {answer.status}: {said}")
    return body
