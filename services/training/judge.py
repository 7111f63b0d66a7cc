"""Procedure and errors of one attempt, from the frames of the bus, live or in a file."""

from __future__ import annotations

from collections import Counter

import msgspec

from trocar.services.training.errors import ErrorEvent, ErrorLog
from trocar.services.training.procedure import Procedure
from trocar.services.training.scenario import Phase, Scenario
from trocar.services.training.site import Site
from trocar.services.training.situation import Situation, SituationReader


class Judge:
    """Processes every frame of an attempt, from its first motion on.

    Args:
        scenario: The scenario with its limits.
        site: Site of the mouth; without it rules that need it are skipped (E11, the view in E12, the opening in E2).
    """

    def __init__(self, scenario: Scenario, site: Site | None = None) -> None:
        self.procedure = Procedure(scenario)
        self.log = ErrorLog(scenario)
        self._observer = SituationReader(site)
        self._last: Situation | None = None

    @property
    def phase(self) -> Phase:
        """The present phase."""
        return self.procedure.phase

    @property
    def errors(self) -> dict[str, int]:
        """The number of errors so far, by code."""
        return dict(Counter(event.code for event in self.log.events))

    @property
    def events(self) -> list[ErrorEvent]:
        """The errors so far."""
        return self.log.events

    def take_frame(self, topic: str, time_ns: int, body: msgspec.Struct) -> Situation | None:
        """Process a frame; return the situation if one was judged. Its tick counts, not its time of arrival."""
        situation = self._observer.take_body(topic, body)
        if situation is not None:
            self._last = situation
            self.procedure.take_situation(situation)
            self.log.take_situation(situation, self.procedure)
        return situation

    def finish(self) -> None:
        """Judge the end of a completed attempt: the final depth of the catheter."""
        self.procedure.finish()
        if self._last is not None:
            self.log.take_situation(self._last, self.procedure)
