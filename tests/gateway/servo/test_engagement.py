from __future__ import annotations

import itertools

import pytest

from trocar.services.gateway.servo.engagement import SETTLE_S, Engagement, State

DT_S = 1e-3


def _steps(engagement: Engagement, seconds: float, **inputs: object) -> bool:
    values = {"fresh": True, "alive": True, "demand_n": 0.0, "calibrated": True} | inputs
    began = [engagement.step(DT_S, **values) for _ in range(round(seconds / DT_S))]  # type: ignore[arg-type]
    return any(began)


def _active() -> Engagement:
    engagement = Engagement(ramp_s=0.5)
    engagement.open(calibrated=True)
    assert _steps(engagement, SETTLE_S + 0.6)
    assert engagement.state is State.ACTIVE
    return engagement


def test_force_begins_after_a_fresh_stream_of_100_ms_and_ramps_up() -> None:
    engagement = Engagement(ramp_s=0.5)
    engagement.open(calibrated=True)
    assert not _steps(engagement, SETTLE_S - 0.002)
    assert engagement.state is State.READY
    assert _steps(engagement, 0.003)
    gains = []
    for _ in range(510):
        _steps(engagement, DT_S)
        gains.append(engagement.gain)
    assert max(b - a for a, b in itertools.pairwise(gains)) == pytest.approx(DT_S / 0.5)
    assert engagement.state is State.ACTIVE
    assert engagement.gain == 1.0


@pytest.mark.parametrize("spoiled", [{"fresh": False}, {"demand_n": 0.4}, {"calibrated": False}])
def test_one_bad_tick_begins_the_wait_anew(spoiled: dict[str, object]) -> None:
    engagement = Engagement(ramp_s=0.5)
    engagement.open(calibrated=True)
    _steps(engagement, 0.09)
    _steps(engagement, DT_S, **spoiled)
    _steps(engagement, 0.09)
    assert engagement.state is State.READY
    assert engagement.gain == 0.0


def test_no_force_before_calibration() -> None:
    engagement = Engagement(ramp_s=0.0)
    engagement.open(calibrated=False)
    _steps(engagement, 1.0, calibrated=False)
    assert engagement.state is State.CALIBRATING
    _steps(engagement, 0.2)
    assert engagement.engaged


def test_a_dead_stream_is_stale_and_comes_back_through_a_new_engagement() -> None:
    engagement = _active()
    _steps(engagement, DT_S, fresh=False, alive=True)
    assert engagement.state is State.ACTIVE, "late, not dead"
    _steps(engagement, DT_S, fresh=False, alive=False)
    assert (engagement.state, engagement.gain) == (State.STALE, 0.0)
    _steps(engagement, 0.09)
    assert engagement.gain == 0.0
    _steps(engagement, 0.02)
    assert engagement.state is State.ENGAGING


def test_a_stop_holds_until_the_rig_is_armed() -> None:
    engagement = _active()
    engagement.stop()
    _steps(engagement, 1.0)
    assert (engagement.state, engagement.gain) == (State.READY, 0.0)
    engagement.arm()
    assert _steps(engagement, 0.2)


def test_a_fault_keeps_its_first_reason_and_is_latched_until_armed() -> None:
    engagement = _active()
    engagement.fail("first")
    engagement.fail("second")
    engagement.let_go()
    _steps(engagement, 1.0)
    assert (engagement.state, engagement.fault, engagement.gain) == (State.FAULT, "first", 0.0)
    engagement.arm()
    assert (engagement.state, engagement.fault) == (State.READY, "")


def test_a_fault_during_a_stop_needs_the_arming_too() -> None:
    engagement = _active()
    engagement.stop()
    engagement.fail("drive")
    _steps(engagement, 0.5)
    assert engagement.state is State.FAULT


def test_how_long_force_was_refused_because_too_much_is_asked_for() -> None:
    engagement = Engagement(ramp_s=0.5)
    engagement.open(calibrated=True)
    _steps(engagement, 1.0, fresh=False, demand_n=2.0)
    assert engagement.refused_s == 0.0, "it is the stream that is missing"
    _steps(engagement, 1.0, demand_n=2.0)
    assert engagement.refused_s == pytest.approx(1.0)
    _steps(engagement, DT_S)
    assert engagement.refused_s == 0.0
    engagement.stop()
    _steps(engagement, 1.0, demand_n=2.0)
    assert engagement.refused_s == 0.0, "a person has stopped it"
