"""What a command of Trocar ends with: one number for each kind of end, the same in every verb and process."""

from __future__ import annotations

from enum import IntEnum


class ExitCode(IntEnum):
    """Exit codes; `meaning` says when each is given."""

    meaning: str

    def __new__(cls, number: int, meaning: str) -> ExitCode:
        """Return a member that is its number and knows its meaning."""
        member = int.__new__(cls, number)
        member._value_ = number
        member.meaning = meaning
        return member

    SUCCESS = (0, "What was asked for was done; for a rig: it ran, and a person or `--seconds` ended it.")
    FAILURE = (
        1,
        "It was tried and failed: a check does not hold (`doctor`, `replay --check`, `stability`), the system refused "
        "something on the way (a full disk), or nobody reads the output any more; with a traceback, a fault of Trocar.",
    )
    USAGE = (
        2,
        "What was asked for cannot be: an option, a key or a name that is not known, or a file that is not there, that "
        "this user may not read or write, or that is no configuration.",
    )
    BUS = (
        3,
        "No connection: no rig runs here, one runs already, nobody answers, or an address or a socket is in use or "
        "closed to this user.",
    )
    LACKING = (4, "The machine lacks something: a device, a display, a vendor's library, a Python package.")
    RECORDING = (5, "A recording is there, but is none or is damaged, or one could not be written to its end.")
    ENDED_BY_PERSON = (6, "Of a process: a person closed its window. The supervisor then ends the rig with 0.")
    HOLE = (7, "A part in the middle of a recording cannot be read, or the recorder was killed as it wrote.")
    INTERRUPTED_START = (8, "A rig was ended before it ran, by Ctrl-C or the stop of a service.")
    INTERRUPTED = (130, "Ctrl-C ended a verb. Another signal N gives 128 + N, as a shell counts.")
