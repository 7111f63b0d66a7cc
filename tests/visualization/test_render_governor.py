"""What a window gives up when pictures take too long, and when it takes it back."""

import pytest

from trocar.services.visualization.render_governor import (
    RUNGS,
    SOFTWARE_RUNG,
    WANTED_IN_SOFTWARE_HZ,
    Demand,
    RenderGovernor,
)


class Drawing:
    """Pictures of a given cost, one after the other."""

    def __init__(self, *, software: bool) -> None:
        self.governor = RenderGovernor(software=software)
        self.now_s = 0.0

    def run(self, seconds: float, cost_s, every_s: float = 1 / 36) -> None:
        end_s = self.now_s + seconds
        while self.now_s < end_s:
            spent_s = cost_s(RUNGS[self.governor.rung])
            self.now_s += max(every_s, spent_s)
            self.governor.drawn(self.now_s, spent_s)


def test_software_begins_plain_and_a_graphics_processor_with_everything():
    assert RenderGovernor(software=True).rung == SOFTWARE_RUNG
    assert RenderGovernor(software=False).rung == 0
    assert not RUNGS[SOFTWARE_RUNG].effects.fine


def test_pixels_are_given_up_until_there_are_enough_pictures_and_no_further():
    drawing = Drawing(software=True)
    drawing.run(10.0, lambda rung: 0.1 * rung.scale**2)
    assert RUNGS[drawing.governor.rung].scale == 0.8, "0.64 of 100 ms is less than the 83 ms that are wanted"
    assert drawing.governor.rate_hz >= WANTED_IN_SOFTWARE_HZ
    drawing.run(60.0, lambda rung: 0.1 * rung.scale**2)
    assert RUNGS[drawing.governor.rung].scale == 0.8


def test_one_slow_second_is_chance():
    drawing = Drawing(software=True)
    for _ in range(20):
        drawing.run(1.5, lambda rung: 0.1)
        drawing.run(1.5, lambda rung: 0.02)
    assert drawing.governor.rung == SOFTWARE_RUNG


def test_pixels_come_back_where_they_are_foreseen_to_fit():
    drawing = Drawing(software=True)
    drawing.run(10.0, lambda rung: 0.2)
    assert RUNGS[drawing.governor.rung].scale == 0.64
    drawing.run(60.0, lambda rung: 0.07 * rung.scale**2)
    assert RUNGS[drawing.governor.rung].scale == 1.0


def test_effects_come_back_when_there_is_time_again():
    drawing = Drawing(software=False)
    drawing.run(5.0, lambda rung: 0.06)
    assert drawing.governor.rung > 1
    drawing.run(120.0, lambda rung: 0.002)
    assert drawing.governor.rung == 0


def test_a_rung_that_was_too_much_is_tried_ever_more_rarely():
    drawing = Drawing(software=False)
    changes = []
    for _ in range(600):
        before = drawing.governor.rung
        drawing.run(1.0, lambda rung: 0.1 if rung.effects.samples else 0.005)
        if drawing.governor.rung < before:
            changes.append(drawing.now_s)
    assert 2 <= len(changes) <= 6, "ten minutes, not once every ten seconds"


def test_a_machine_that_is_too_slow_for_anything_stays_on_the_last_rung():
    drawing = Drawing(software=True)
    drawing.run(60.0, lambda rung: 0.5)
    assert drawing.governor.rung == len(RUNGS) - 1


def test_a_window_is_sent_somewhat_more_than_it_paints_and_all_when_it_paints_all() -> None:
    demand = Demand()
    assert demand.count(0.0, 0) is None
    able_hz, painted, hz = 12.0, 1.0, None
    for tick in range(100):
        hz = demand.count(0.1 * tick, int(painted))
        painted += 0.1 * min(able_hz, hz or 60.0)
    assert hz == pytest.approx(1.25 * able_hz, rel=0.1)
    able_hz = 60.0
    for tick in range(100, 400):
        hz = demand.count(0.1 * tick, int(painted))
        painted += 0.1 * min(able_hz, hz or 60.0)
    assert hz is not None
    assert hz >= 60.0
    for tick in range(400, 450):
        hz = demand.count(0.1 * tick, int(painted))  # it hangs
    assert hz == 10.0
