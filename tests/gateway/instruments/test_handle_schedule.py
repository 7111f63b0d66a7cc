from __future__ import annotations

from trocar.services.gateway.instruments.handle_schedule import PATIENCE, HandleSchedule


def test_each_handle_has_its_turn() -> None:
    turns = HandleSchedule(3)
    assert [turns.next(late=False) for _ in range(7)] == [0, 1, 2, 0, 1, 2, 0]


def test_a_late_answer_puts_a_handle_off_and_takes_no_turn_from_it() -> None:
    turns = HandleSchedule(2)
    assert [turns.next(late=late) for late in (False, True, False, True, True, False)] == [0, None, 1, None, None, 0]


def test_handles_do_not_wait_for_a_haptics_that_is_silent() -> None:
    """Their drives let go, and their torque would stay, if nobody served them."""
    turns = HandleSchedule(2)
    served = [turns.next(late=True) for _ in range(PATIENCE + 4)]
    assert served == [None] * PATIENCE + [0, 1, 0, 1]
    assert turns.next(late=False) == 0
    assert turns.next(late=True) is None


def test_a_rig_without_instruments_serves_none() -> None:
    assert HandleSchedule(0).next(late=False) is None
