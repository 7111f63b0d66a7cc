"""What is said of stalls that a loop measures."""

import trocar.protocol.bodies as bodies
from trocar.services.supervisor.crew.stall_messages import StallMessages


def stall(index: int, length_ms: float) -> bodies.Stall:
    return bodies.Stall(index=index, ended_ns=index, length_ns=round(1e6 * length_ms))


def test_each_stall_is_told_once_and_a_busy_host_takes_a_line_a_second() -> None:
    messages, told = StallMessages(), []
    for report in range(31):
        now_s = 0.1 * report
        messages.hear([stall(report + 1, 20.0 + report), stall(report + 2, 21.0 + report)], starts=False)
        told.append(messages.turn(now_s))
    said = [text for text in told if text]
    assert said[0] == "stalled for 20, 21 ms"
    assert said[1] == "stalled for 22, 23, 24, 25, 26, 27, 28, 29, 30, 31 ms"
    assert len(said) == 4


def test_stalls_of_the_start_are_not_told() -> None:
    messages = StallMessages()
    messages.hear([stall(1, 900.0)], starts=True)
    messages.hear([stall(1, 900.0), stall(2, 12.0)], starts=False)
    assert messages.turn(0.0) == "stalled for 12 ms"
    assert messages.turn(9.0) == ""
