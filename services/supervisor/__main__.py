"""The supervisor as a process: ``python -m trocar.services.supervisor``. `trocar up` does the same and shows its
status.
"""

from __future__ import annotations

import trocar.services.start.entry  # noqa: F401  first: the environment of a process

# isort: split
import sys
from collections.abc import Sequence
from contextlib import closing

import trocar.protocol.bodies as bodies
from trocar.services.runtime import log
from trocar.services.runtime.errors import UserError
from trocar.services.runtime.process.process import parse
from trocar.services.start import start_up
from trocar.services.supervisor.control.supervisor import Supervisor
from trocar.services.supervisor.crew.fork_link import ForkServer
from trocar.services.supervisor.judge.state_machine import RigState
from trocar.services.supervisor.session import SessionOptions, open_session, run_session


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the supervisor from its command line; return the exit code."""
    start_up.end()
    try:
        options = parse("supervisor", arguments)
        if options.prepare_only:  # nothing to prepare
            return 0
        with closing(ForkServer()) as fork_server:
            process = open_session(options)
            try:
                turn = _Greeting().greet_person
                run_session(process, SessionOptions(options, on_event=_print, on_turn=turn, fork_server=fork_server))
            finally:
                process.bus.close()
    except UserError as error:
        print(f"supervisor: {error}", file=sys.stderr)  # noqa: T201
        return error.exit_code
    return 0


class _Greeting:
    """Prints the page's address at the start, and again when the rig runs, as many lines come in between.

    It is never an event, because events are shown on the page and the token is secret.
    """

    def __init__(self) -> None:
        self._due = ["the rig is starting", "the rig runs"]

    def greet_person(self, supervisor: Supervisor, _now_s: float) -> bool:
        runs = supervisor.state in (RigState.RUNNING, RigState.DEGRADED)
        if len(self._due) == 2 or (self._due and runs):
            print(f"{self._due.pop(0)}: open {supervisor.page_address}", file=sys.stderr, flush=True)  # noqa: T201
        return False


def _print(event: bodies.Event) -> None:
    if log.LEVELS[event.level] >= (log.asked_level() or log.LEVELS["debug"]):
        print(f"{event.t:8.2f} {event.level.upper():7} {event.text}", file=sys.stderr)  # noqa: T201


if __name__ == "__main__":
    sys.exit(main())
