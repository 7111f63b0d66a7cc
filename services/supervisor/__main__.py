"""The supervisor as a process: ``python -m services.supervisor``. On a bench `trocar up` is the same with a face."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from services.runtime.errors import UserError
from services.runtime.process import parse
from services.supervisor.session import Plan, open_session, run_session
from services.supervisor.supervisor import Event


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the supervisor from its command line; return the exit code."""
    try:
        options = parse("supervisor", arguments)
        process = open_session(options)
        try:
            run_session(process, Plan(options, on_event=_print))
        finally:
            process.bus.close()
    except UserError as error:
        print(f"supervisor: {error}", file=sys.stderr)  # noqa: T201
        return error.exit_code
    return 0


def _print(event: Event) -> None:
    print(f"{event.t:8.2f} {event.level.upper():7} {event.text}", file=sys.stderr)  # noqa: T201


if __name__ == "__main__":
    sys.exit(main())
