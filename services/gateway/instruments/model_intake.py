"""Intake of contact models: each is checked and matched to the device sample that it answers, to measure latency."""

from __future__ import annotations

import numpy as np

from trocar.protocol import Frame
from trocar.protocol.bodies.haptics import MODEL_COLUMNS
from trocar.services.gateway.instruments.instrument import Instrument
from trocar.services.gateway.servo.servo_arrays import are_models
from trocar.services.runtime.loop.flat_view import flat_view
from trocar.services.runtime.process.health import LatencyPath

#: Number of samples that a model may still answer: older ones have expired, as a model lives for 20 ms at most.
_REMEMBERED = 128


class ModelIntake:
    """Passes contact models to the servos and measures their latency from the device sample.

    Args:
        instruments: Instruments in the order of the device frames.
        arrival: Latency from a device sample to the arrival of the first model that answers it. Only ``timed`` samples
            count: a gateway that does not wait for a model does not know when it arrived.
        force: Latency from a device sample to the first force computed from that model.

    Attributes:
        refused: dict. Number of unused models, by reason.
    """

    def __init__(self, instruments: list[Instrument], arrival: LatencyPath, force: LatencyPath) -> None:
        self.refused = {"invalid": 0, "not_asked": 0, "instruments": 0, "numbers": 0}
        self._instruments = instruments
        self._models = np.zeros((len(instruments), MODEL_COLUMNS))
        self._rows = list(self._models)
        self._bytes = flat_view(self._models).cast("B")
        are_models(self._models)  # compiles it before the first tick
        self._arrival = arrival
        self._force = force
        self._sampled_ns = [0] * _REMEMBERED
        self._posed_ns = [0] * _REMEMBERED
        self._asked = [-1] * _REMEMBERED
        self._newest_answered = self._heard = -1
        self._last_asked = -1
        self._timed = -1
        self._unapplied_ns = 0
        self._accepted = self._invalid_looks = 0
        self._seen = (0, 0)

    def invalid_looks(self) -> int:
        """Check the models since the last call; return how many checks in a row found most of them invalid."""
        (invalid, accepted), self._seen = self._seen, (self.refused["invalid"], self._accepted)
        mostly = self._seen[0] - invalid > self._seen[1] - accepted
        self._invalid_looks = self._invalid_looks + 1 if mostly else 0
        return self._invalid_looks

    def expect_answer(self, index: int, sampled_ns: int, *, timed: bool, posed_ns: int | None = None) -> None:
        """Store that the device sample of tick `index` was published, and whether its answer will be waited for.

        `posed_ns` is the time of the sample for the servos, if that is not `sampled_ns`.
        """
        self._sampled_ns[index % _REMEMBERED] = sampled_ns
        self._posed_ns[index % _REMEMBERED] = sampled_ns if posed_ns is None else posed_ns
        self._asked[index % _REMEMBERED] = index
        self._last_asked = index
        if timed:
            self._timed = index

    @property
    def timed(self) -> bool:
        """Whether the gateway waits for the answer to the newest sample."""
        return self._timed == self._last_asked and self.outstanding

    @property
    def outstanding(self) -> bool:
        """Whether the newest sample still waits for its model."""
        return self._newest_answered < self._last_asked

    @property
    def is_unheard(self) -> bool:
        """Whether haptics has not said anything about the newest sample, not even that there is no force."""
        return self._heard < self._last_asked

    def accept(self, frame: Frame, now_ns: int) -> None:
        """Pass the models of a frame to the servos, if it answers a known sample."""
        body = frame.body
        slot = body.tick % _REMEMBERED
        if self._asked[slot] == body.tick:
            self._heard = max(self._heard, body.tick)
        if not frame.valid:
            self.refused["invalid"] += 1
        elif self._asked[slot] != body.tick:
            self.refused["not_asked"] += 1
        elif len(body.models.data) != len(self._bytes):
            self.refused["instruments"] += 1
        elif not self._take_models(body.models.data):
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
                instrument.servo.accept(model, body.ttl_s, self._posed_ns[slot], frame.incarnation)
                instrument.model_sequence = frame.sequence

    def _take_models(self, rows: bytes) -> bool:
        """Copy the table's bytes into an array; return False if they are no models."""
        self._bytes[:] = rows
        return bool(are_models(self._models))

    def applied(self, now_ns: int) -> None:
        """Count, right after the forces were written, whether the previous sample was answered in time."""
        if self._last_asked >= 0:
            in_time = self._newest_answered == self._last_asked
            for path in (self._arrival, self._force):
                path.asked += 1
                path.answered += in_time
        if self._unapplied_ns:
            self._force.latency.record(now_ns - self._unapplied_ns)
            self._unapplied_ns = 0
