"""The whole transition table: every state against every situation that matters."""

from __future__ import annotations

import itertools

import pytest

from trocar.services.supervisor.judge.state_machine import RigFacts, RigState, next_state

OFF, STARTING, READY = RigState.OFF, RigState.STARTING, RigState.READY
RUNNING, DEGRADED, SAFE_STOP = RigState.RUNNING, RigState.DEGRADED, RigState.SAFE_STOP

LOST = RigFacts(trouble=True)
UP = RigFacts(all_ready=True)
WELL = RigFacts(all_ready=True, settled=True, calm=True)
BREACH = RigFacts(all_ready=True, settled=True, trouble=True)
CALMING = RigFacts(all_ready=True, settled=True, calm=False)
STALLING = RigFacts(trouble=True, stalling=True)

TABLE = {
    OFF: {LOST: STARTING, UP: STARTING, WELL: STARTING, BREACH: STARTING, CALMING: STARTING, STALLING: STARTING},
    STARTING: {LOST: STARTING, UP: READY, WELL: READY, BREACH: READY, CALMING: READY, STALLING: READY},
    READY: {LOST: STARTING, UP: READY, WELL: RUNNING, BREACH: RUNNING, CALMING: RUNNING, STALLING: DEGRADED},
    RUNNING: {LOST: DEGRADED, UP: RUNNING, WELL: RUNNING, BREACH: DEGRADED, CALMING: RUNNING, STALLING: DEGRADED},
    DEGRADED: {LOST: DEGRADED, UP: DEGRADED, WELL: RUNNING, BREACH: DEGRADED, CALMING: DEGRADED, STALLING: DEGRADED},
    SAFE_STOP: {LOST: STARTING, UP: STARTING, WELL: STARTING, BREACH: STARTING, CALMING: STARTING, STALLING: STARTING},
}
CASES = [(state, situation, TABLE[state][situation]) for state in TABLE for situation in TABLE[state]]


@pytest.mark.parametrize(("state", "situation", "expected"), CASES)
def test_transition(state: RigState, situation: RigFacts, expected: RigState) -> None:
    assert next_state(state, situation) is expected


@pytest.mark.parametrize("state", RigState)
def test_a_safe_stop_wins_over_everything(state: RigState) -> None:
    for ready, trouble, settled, calm in itertools.product((False, True), repeat=4):
        stopped = RigFacts(all_ready=ready, trouble=trouble, settled=settled, calm=calm, safe_stop=True)
        assert next_state(state, stopped) is SAFE_STOP


def test_a_safe_stop_is_left_only_by_passing_ready_again() -> None:
    """Whatever the situation, nothing leads from SAFE_STOP to RUNNING in one step."""
    for values in itertools.product((False, True), repeat=4):
        ready, trouble, settled, calm = values
        now = RigFacts(all_ready=ready, trouble=trouble, settled=settled, calm=calm)
        assert next_state(SAFE_STOP, now) is STARTING
