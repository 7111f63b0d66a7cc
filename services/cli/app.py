"""The `trocar` command: one verb per file, imported only when it is used, so that ``trocar --help`` is quick."""

from __future__ import annotations

import os
import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from services.runtime.errors import UserError

app = typer.Typer(
    name="trocar", no_args_is_help=True, add_completion=True, pretty_exceptions_enable=False,
    help="Trocar: an open laparoscopic haptic trainer.",
)  # fmt: skip
config_app = typer.Typer(no_args_is_help=True, help="Show configuration, and what it may say.")
app.add_typer(config_app, name="config")

Rig = Annotated[str, typer.Option("--rig", help="Rig file, or the name of one in configs/rigs.")]
Overrides = Annotated[list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Change one key of the rig.")]
Json = Annotated[bool, typer.Option("--json", help="One JSON object on standard output.")]


class Viewer(StrEnum):
    """Where the picture is shown."""

    AUTO = "auto"
    NATIVE = "native"
    WEB = "web"
    NONE = "none"


@app.command()
def up(
    rig: Rig = "stub",
    scene: Annotated[str | None, typer.Option(help="Scene file, or the name of one in configs/scenes.")] = None,
    seconds: Annotated[
        float | None, typer.Option(min=0.1, help="Run so long, measured from RUNNING, then end.")
    ] = None,
    json_file: Annotated[Path | None, typer.Option("--json", help="Write what the run did to this file.")] = None,
    viewer: Annotated[Viewer | None, typer.Option(help="Where the picture is shown; default: as the rig says.")] = None,
    overrides: Overrides = None,
) -> None:
    """Start the whole rig and stay with it until Ctrl-C."""
    from services.cli.up import Request, run_up

    run_up(Request(rig, scene, seconds, json_file, viewer and viewer.value, tuple(overrides or ())))


@app.command()
def down(rig: Rig = "stub", overrides: Overrides = None, json: Json = False) -> None:
    """End a rig that runs on this host, whatever is left of it."""
    from services.cli.down import run_down

    run_down(rig, tuple(overrides or ()), json)


def main() -> None:
    """Run the command; what a person can mend is one sentence and an exit code."""
    try:
        app()
    except UserError as error:
        print(f"trocar: {error}", file=sys.stderr)
        sys.exit(error.exit_code)
    except BrokenPipeError:  # `trocar sniff | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)


def typer_app() -> Any:
    """Return the application, for documentation and tests."""
    return app


if __name__ == "__main__":
    main()
