"""A report of a process, made in one go for who asks: processes make theirs in pieces and send them."""

from __future__ import annotations

from trocar.protocol.bodies import Health
from trocar.services.runtime.process.health import HealthReporter


def report_of(reporter: HealthReporter) -> Health:
    """Return what the reporter would say now; nothing is sent."""
    pieces = reporter._compose()
    while True:
        try:
            next(pieces)
        except StopIteration as end:
            health: Health = end.value
            return health
