"""The journal of a loop: every tick of the rig's clock once, with what was taken in."""

import numpy as np
import pytest

from trocar.services.runtime.bus.journal import JournalWriter


class Heard:
    """A bus that keeps what is published."""

    def __init__(self):
        self.bodies = []

    def publish(self, topic, body):
        self.bodies.append(body)


def told(ticks):
    """Return the runs (k, 6) of a journal in which these ticks were noted."""
    bus = Heard()
    writer = JournalWriter("physics.journal", bus)
    for tick, level in ticks:
        writer.note(tick, (1, level, 0))
    writer.send()
    return bus.bodies[0].runs.view().tolist()


def noted(runs):
    """Return the ticks of runs with their facts."""
    return [(first + k * stride, *facts) for first, count, stride, *facts in runs for k in range(int(count))]


@pytest.mark.parametrize("again", [(), (3, 3), (7,)])
def test_where_the_clock_stands_a_tick_is_noted_once(again):
    """A rig that is paused goes on telling of the tick at which it stands."""
    ticks = [(tick, int(tick > 4)) for tick in range(1, 9)]
    paused = sorted([*ticks, *((tick, int(tick > 4)) for tick in again)])
    assert noted(told(paused)) == noted(told(ticks)) == [(tick, 1, level, 0) for tick, level in ticks]


def test_ticks_that_were_lost_are_no_run():
    rng = np.random.default_rng(3)
    ticks = sorted(set(rng.integers(0, 400, 200).tolist()))
    assert [tick for tick, *_ in noted(told([(tick, 0) for tick in ticks]))] == ticks
