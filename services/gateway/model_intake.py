"""Intake of contact models: each is checked, matched to the device sample that it answers, and its latency measured."""

from __future__ import annotations

import numpy as np

from protocol import Frame
from protocol.bodies.haptics import MODEL_COLUMNS
from services.gateway.instrument import Instrument
from services.gateway.servo_arrays import are_models
from services.runtime.flat_view import flat_view
from services.runtime.health import LatencyPath

#: Samples that a model may still answer: older ones are beyond every time to live.
_REMEMBERED = 128


class ModelIntake:
    """Gives contact models to the servos and measures the latency from the device sample.

    Args:
        instruments: In the order of the device frames.
        arrival: Latency from a device sample to the arrival of the first model that answers it. Only ``timed`` samples
            count: a gateway that does not wait for a model does not know when it arrived.
        force: Latency from a device sample to the first force computed from that model.

    Attributes:
        refused: dict. Models not used, by reason.
    """

    def __init__(self, instruments: list[Instrument], arrival: LatencyPath, force: LatencyPath) -> None:
        self.refused = {"invalid": 0, "not_asked": 0, "instruments": 0, "numbers": 0}
        self._instruments = instruments
        self._models = np.zeros((len(instruments), MODEL_COLUMNS))
        self._rows = list(self._models)
        self._bytes = flat_view(self._models).cast("B")
        are_models(self._models)  # compiled here, and not in a tick
        self._arrival = arrival
        self._force = force
        self._sampled_ns = [0] * _REMEMBERED
        self._asked = [-1] * _REMEMBERED
        self._newest_answered = -1
        self._last_asked = -1
        self._timed = -1
        self._unapplied_ns = 0
        self._accepted = self._invalid_looks = 0
        self._seen = (0, 0)

    def invalid_looks(self) -> int:
        """Look; return how many looks in a row found that most models since the one before were invalid."""
        (invalid, accepted), self._seen = self._seen, (self.refused["invalid"], self._accepted)
        mostly = self._seen[0] - invalid > self._seen[1] - accepted
        self._invalid_looks = self._invalid_looks + 1 if mostly else 0
        return self._invalid_looks

    def ask(self, index: int, sampled_ns: int, *, timed: bool) -> None:
        """Remember that the device sample of tick `index` was published, and whether its answer will be waited for."""
        self._sampled_ns[index % _REMEMBERED] = sampled_ns
        self._asked[index % _REMEMBERED] = index
        self._last_asked = index
        if timed:
            self._timed = index

    @property
    def timed(self) -> bool:
        """Whether the answer to the newest sample is to be waited for."""
        return self._timed == self._last_asked and self.outstanding

    @property
    def outstanding(self) -> bool:
        """Whether the newest sample still waits for its model."""
        return self._newest_answered < self._last_asked

    def accept(self, frame: Frame, now_ns: int) -> None:
        """Give the models of a frame to the servos, unless it answers nothing that was asked."""
        body = frame.body
        slot = body.tick % _REMEMBERED
        if not frame.valid:
            self.refused["invalid"] += 1
        elif self._asked[slot] != body.tick:
            self.refused["not_asked"] += 1
        elif len(body.models.data) != len(self._bytes):
            self.refused["instruments"] += 1
        elif not self._take(body.models.data):
            self.refused["numbers"] += 1
        else:
            self._accepted += 1
            sampled_ns = self._sampled_ns[slot]
            if body.tick > self._newest_answered:
                self._newest_answered = body.tick
                self._unapplied_ns = sampled_ns
                if body.tick == self._timed:
                    self._arrival.latency.record(now_ns - sampled_ns)
            for instrument, model in zip(self._instruments, self._rows, strict=True):
                instrument.servo.accept(model, body.ttl_s, sampled_ns, frame.incarnation)
                instrument.model_sequence = frame.sequence

    def _take(self, rows: bytes) -> bool:
        """Copy the table's bytes to where numpy knows them; False if they are no models."""
        self._bytes[:] = rows
        return bool(are_models(self._models))

    def applied(self, now_ns: int) -> None:
        """Count, right after the forces were written: was the sample before this one answered in time."""
        if self._last_asked >= 0:
            in_time = self._newest_answered == self._last_asked
            for path in (self._arrival, self._force):
                path.asked += 1
                path.answered += in_time
        if self._unapplied_ns:
            self._force.latency.record(now_ns - self._unapplied_ns)
            self._unapplied_ns = 0
