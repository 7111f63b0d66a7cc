"""The last score of each trainee of a class, asked of the database by one thread of its own, which holds up no rig."""

from __future__ import annotations

import threading
from collections.abc import Callable

from trocar.review.attempts.store.attempts import Store
from trocar.review.classroom.roll import Roll
from trocar.services.runtime.errors import UserError

EVERY_S = 30.0  # an attempt takes minutes; the database is elsewhere, and every desk asks it


class Scores:
    """Asks for scores until it is closed.

    Args:
        roll: Returns the class as it is now: its file may change.

    Attributes:
        remark: str. Why scores cannot be had, or not all; empty if they can.
    """

    def __init__(self, roll: Callable[[], Roll]) -> None:
        self.remark = ""
        self._roll = roll
        self._totals: dict[str, float] = {}
        self._due, self._ends = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run, name="scores", daemon=True)
        self._thread.start()

    def of(self, trainee: str) -> float | None:
        """Return the last score of a trainee that is known."""
        return self._totals.get(trainee)

    def ask_store(self) -> None:
        """Ask at once, as the class has changed."""
        self._due.set()

    def close(self) -> None:
        """Ask no more."""
        self._ends.set()
        self._due.set()

    def _run(self) -> None:
        while not self._ends.is_set():
            self._look()
            self._due.wait(EVERY_S)
            self._due.clear()

    def _look(self) -> None:
        roll, remarks = self._roll(), list[str]()
        trainees = {place.trainee for place in roll.rig} - {""}
        if roll.database is not None and trainees:
            try:
                with Store(roll.database, create=False, tell=remarks.append) as store:
                    self._totals = store.last_totals(trainees)
            except UserError as error:
                remarks = [str(error)]
        else:
            self._totals = {}
        self.remark = "; ".join(remarks)
