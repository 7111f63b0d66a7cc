"""Options that several verbs of the `trocar` command share."""

from __future__ import annotations

import math
from typing import Annotated

import typer

Rig = Annotated[str, typer.Option("--rig", envvar="TROCAR_RIG", help="Rig file, or the name of one in configs/rigs.")]
Scene = Annotated[
    str | None, typer.Option("--scene", envvar="TROCAR_SCENE", help="Scene file, or the name of one in configs/scenes.")
]
Overrides = Annotated[
    list[str] | None, typer.Option("--set", metavar="KEY=VALUE", envvar="TROCAR_SET", help="Change one key of the rig.")
]
Address = Annotated[str | None, typer.Option(help="Address of the supervisor's page; default: the one of this host.")]
Token = Annotated[str | None, typer.Option(help="Token that the rig printed, with --address.")]
Fingerprint = Annotated[
    str | None,
    typer.Option(help="SHA-256 fingerprint of its certificate, which the rig printed, with an https --address."),
]
Json = Annotated[bool, typer.Option("--json", help="One JSON object on standard output.")]


def finite(value: float | None) -> float | None:
    """Refuse a length of time that is infinite or not a number."""
    if value is not None and not math.isfinite(value):
        raise typer.BadParameter(f"{value} is no length of time")
    return value
