"""What a call costs, counted: the same on every machine."""

import sys
from contextlib import contextmanager


class Count:
    """Instructions of the interpreter, while it runs."""

    def __init__(self):
        self.instructions = 0

    def __call__(self, frame, event, _):
        frame.f_trace_opcodes, frame.f_trace_lines = True, False
        self.instructions += event == "opcode"
        return self


@contextmanager
def counted():
    count, before = Count(), sys.gettrace()
    sys._getframe().f_trace_opcodes = True  # Python 3.12 counts instructions only if a frame asks before it traces
    sys.settrace(count)
    try:
        yield count
    finally:
        sys.settrace(before)


def instructions(call, *arguments):
    """Return how many instructions of the interpreter a call takes."""
    with counted() as count:
        call(*arguments)
    return count.instructions
