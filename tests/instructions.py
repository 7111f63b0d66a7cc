"""What a call costs, counted: the same on every machine."""

from __future__ import annotations

import sys
from collections.abc import Callable
from types import CodeType, FrameType


class Count:
    """Instructions of the interpreter, but those of this file."""

    def __init__(self) -> None:
        self.instructions = 0

    def add(self, code: CodeType, _offset: int) -> None:
        """Count an instruction that `sys.monitoring` tells of."""
        self.instructions += code.co_filename != __file__

    def trace(self, frame: FrameType, event: str, _argument: object) -> Callable[..., object]:
        """Count what `sys.settrace` tells of."""
        frame.f_trace_opcodes, frame.f_trace_lines = True, False
        if event == "opcode":
            self.add(frame.f_code, frame.f_lasti)
        return self.trace


def instructions(call: Callable[..., object], *arguments: object) -> int:
    """Return how many instructions of the interpreter a call takes.

    From Python 3.12 on `sys.monitoring` tells of them: a tracer there hears of some frames only.
    """
    count = Count()
    (_monitor if sys.version_info >= (3, 12) else _trace)(count, call, arguments)
    return count.instructions


def _trace(count: Count, call: Callable[..., object], arguments: tuple[object, ...]) -> None:
    before = sys.gettrace()
    sys.settrace(count.trace)
    try:
        call(*arguments)
    finally:
        sys.settrace(before)


def _monitor(count: Count, call: Callable[..., object], arguments: tuple[object, ...]) -> None:
    monitoring = sys.monitoring
    tool, instruction = monitoring.PROFILER_ID, monitoring.events.INSTRUCTION
    monitoring.use_tool_id(tool, __name__)
    monitoring.register_callback(tool, instruction, count.add)
    monitoring.set_events(tool, instruction)
    try:
        call(*arguments)
    finally:
        monitoring.set_events(tool, monitoring.events.NO_EVENTS)
        monitoring.register_callback(tool, instruction, None)
        monitoring.free_tool_id(tool)
