"""Cholangiograms of the ends of attempts: each made once, when a report asks for it, by a process of its own."""

from __future__ import annotations

import subprocess
import sys
import threading
from concurrent.futures import Future
from pathlib import Path

from trocar.review.attempts.assessment import Assessment
from trocar.review.school.replays import Replays
from trocar.services.runtime.errors import UserError

_ANSWER_S = 20.0
"""For how long a request waits for a picture, because the page's server gives up after 30 s."""
_PATIENCE_S = 300.0
"""For how long at most a picture is made, because the modes of a duct may have to be computed first, a minute long."""


class Stills:
    """Makes pictures one at a time, and keeps them beside the replays, as they are erased with them."""

    def __init__(self, replays: Replays) -> None:
        self._replays = replays
        self._lock, self._turn = threading.Lock(), threading.Lock()
        self._making: dict[Path, Future[None]] = {}

    def still(self, found: Assessment, recording: Path) -> bytes | None:
        """Return the picture and its sentences as `export.still` writes them; None while it is still drawn.

        Raises UserError if it cannot be drawn.
        """
        path = self._replays.cholangiogram(found.attempt_id)
        if path.is_file():
            return path.read_bytes()
        if not recording.is_file():
            raise UserError(f"{recording.name}: this recording is not there any more")
        with self._lock:
            making = self._making.get(path) or self._begin(path, recording, found.last_moment)
            self._making[path] = making
        try:
            making.result(_ANSWER_S)
        except TimeoutError:
            return None
        finally:
            with self._lock:
                if making.done():
                    self._making.pop(path, None)
        return path.read_bytes()

    def _begin(self, path: Path, recording: Path, end: tuple[int, int]) -> Future[None]:
        """Begin to draw in a thread, which does not hinder this process from ending."""
        making: Future[None] = Future()

        def run() -> None:
            try:
                with self._turn:
                    _draw(path, recording, end)
            except BaseException as error:
                making.set_exception(error)
            else:
                making.set_result(None)

        threading.Thread(target=run, name="cholangiogram", daemon=True).start()
        return making


def _draw(path: Path, recording: Path, end: tuple[int, int]) -> None:
    """Let another process write the file. Raises UserError with what it says if it cannot."""
    path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    command = [sys.executable, "-m", "trocar.review.export.still", str(recording), str(path), *map(str, end)]
    try:
        done = subprocess.run(command, capture_output=True, check=False, timeout=_PATIENCE_S)
    except subprocess.TimeoutExpired:
        raise UserError("the cholangiogram takes too long on this machine") from None
    if done.returncode:
        said = done.stderr.decode(errors="replace").strip().splitlines()
        raise UserError((said or [f"the cholangiogram cannot be drawn: status {done.returncode}"])[-1])
