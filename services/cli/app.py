"""The `trocar` command: a verb is a signature here, and a function that is imported when it is used: help is quick."""

from __future__ import annotations

import trocar.services.start.entry  # noqa: F401  first: the environment of a process

# isort: split
import functools
import importlib
import os
from collections.abc import Callable
from contextlib import closing
from enum import StrEnum
from importlib.metadata import entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any, cast

import typer

from trocar.services.cli import refusals
from trocar.services.cli.options import Address, Fingerprint, Json, Overrides, Rig, Scene, Token, finite
from trocar.services.cli.plain_help import PlainTyper
from trocar.services.runtime import log

app = PlainTyper(
    name="trocar", no_args_is_help=True, add_completion=True, pretty_exceptions_enable=False,
    help="Trocar: an open laparoscopic haptic trainer.",
)  # fmt: skip
VERBS = "trocar.verbs"
#: Options that may be given again.
_LISTS = "overrides", "files", "topics", "names", "held"

config_app = PlainTyper(no_args_is_help=True, help="Show configuration, and what it may say.")
app.add_typer(config_app, name="config")
Verb = Callable[..., None]


def _version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        print(f"trocar {version('trocar')}")
        raise typer.Exit


def _log_level(name: str | None) -> str | None:
    """Hand the level on to all that the verb starts: a process reads it as it starts, whoever starts it."""
    if name is not None:
        log.level_of(name, "--log-level")
        os.environ[log.LEVEL_VARIABLE] = name
    return name


@app.callback()
def everywhere(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and end.")
    ] = False,
    log_level: Annotated[
        str | None,
        typer.Option(
            callback=_log_level, metavar="LEVEL",
            help="What is told on standard error by the verb and the processes that it starts: debug, info, warning or "
            "error; or TROCAR_LOG_LEVEL. Results and refusals are told at every level.",
        ),
    ] = None,
) -> None:  # fmt: skip
    """Trocar: an open laparoscopic haptic trainer."""


def _verb(where: str, name: str | None = None, to: typer.Typer = app, **more: object) -> Callable[[Verb], Verb]:
    """Make a signature a verb that calls with its options, and `more`, what `where` names: MODULE:FUNCTION."""

    def added(signature: Verb) -> Verb:
        @functools.wraps(signature)
        def call(**given: Any) -> None:
            module, _, function = where.partition(":")
            given = {key: tuple(value or ()) if key in _LISTS else value for key, value in given.items()}
            getattr(importlib.import_module(f"trocar.services.{module}"), function)(**given, **more)

        return cast(Verb, to.command(name)(call))

    return added


class Viewer(StrEnum):
    """Where the picture is shown."""

    AUTO = "auto"
    NATIVE = "native"
    WEB = "web"
    NONE = "none"


class SurfaceIs(StrEnum):
    """What of a duct's wall a surface is."""

    LUMEN = "lumen"
    MIDDLE = "middle"


class Unit(StrEnum):
    """Units of length of surface files."""

    M = "m"
    CM = "cm"
    MM = "mm"
    UM = "um"
    IN = "in"


class Axes(StrEnum):
    """Axes of a patient: the first points to the left and the second to the back, or to the right and the front."""

    LPS = "LPS"
    RAS = "RAS"


class AttemptVerb(StrEnum):
    """What may be asked of the attempt that is being made."""

    NEW = "new"
    PAUSE = "pause"
    RESUME = "resume"
    STEP = "step"
    SLOW = "slow"
    BOOKMARK = "bookmark"
    STATUS = "status"


@app.command()
def up(
    rig: Rig = "stub",
    scene: Scene = None,
    scenario: Annotated[
        str | None, typer.Option(help="Scenario file, or the name of one in configs/scenarios: it names its scene.")
    ] = None,
    seconds: Annotated[
        float | None, typer.Option(min=0.1, callback=finite, help="End after this time, measured from RUNNING.")
    ] = None,
    json_file: Annotated[Path | None, typer.Option("--json", help="Write what the run did to this file.")] = None,
    viewer: Annotated[Viewer | None, typer.Option(help="Where the picture is shown; default: as the rig says.")] = None,
    overrides: Overrides = None,
) -> None:
    """Start the whole rig and stay with it until Ctrl-C."""
    from trocar.services.supervisor.crew.fork_link import ForkServer

    with closing(ForkServer()) as fork_server:  # first: it imports on another core than all that follows
        from trocar.services.cli.up import Request, run_up

        shown = viewer and viewer.value
        run_up(Request(rig, scene, seconds, json_file, shown, tuple(overrides or ()), scenario), fork_server)


@_verb("cli.down:run_down")
def down(rig_name: Rig = "stub", overrides: Overrides = None, as_json: Json = False) -> None:
    """End the rig that runs on this host, or what is left of it."""


@_verb("cli.top:run_top")
def top(
    rig: Rig = "stub",
    once: Annotated[bool, typer.Option("--once", help="Print once and end.")] = False,
    as_json: Json = False,
    seconds: Annotated[float, typer.Option(min=0.3, callback=finite, help="Window of the figures.")] = 2.0,
    overrides: Overrides = None,
) -> None:
    """Show rates, lateness, paths and topics of a running rig."""


@_verb("cli.latency:run_latency")
def latency(
    files: Annotated[
        list[Path] | None, typer.Argument(help="Files written with `--save`; default: the running rig.")
    ] = None,
    rig: Rig = "stub",
    worst: Annotated[int, typer.Option(min=1, help="How many ticks to show.")] = 12,
    trace_file: Annotated[Path | None, typer.Option("--trace", help="Write a trace for ui.perfetto.dev.")] = None,
    save: Annotated[Path | None, typer.Option("--save", help="Write the ticks into a file, to look at later.")] = None,
    as_json: Json = False,
    overrides: Overrides = None,
) -> None:
    """Show the worst ticks of the last seconds on one time line, and what else ran on the core."""


@_verb("cli.doctor:run_doctor")
def doctor(rig_name: Rig = "stub", overrides: Overrides = None, as_json: Json = False) -> None:
    """Check what this host can give the rig; exit code 1 if the rig cannot run."""


@_verb("cli.sniff:run_sniff")
def sniff(
    topic: Annotated[str | None, typer.Argument(help="Topic to print; without it, the rates of all.")] = None,
    rig: Rig = "stub",
    count: Annotated[int | None, typer.Option(min=1, help="End after so many frames.")] = None,
    seconds: Annotated[float | None, typer.Option(min=0.1, callback=finite, help="End after so long.")] = None,
    rates: Annotated[
        bool, typer.Option("--hz", help="Rate, gaps and periods of the topic instead of its frames.")
    ] = False,
    every: Annotated[bool, typer.Option("--every", help="Print every frame, not five a second.")] = False,
    as_json: Json = False,
    overrides: Overrides = None,
) -> None:
    """Read the bus with plain msgpack: envelope and body of one topic, or the rates of all."""


@_verb("cli.foxglove:run_foxglove")
def foxglove(
    rig_name: Rig = "stub",
    scene: Scene = None,
    host: Annotated[str, typer.Option(help="Address to serve at.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535)] = 8765,
    rate_hz: Annotated[float, typer.Option("--hz", min=0.1, max=60.0, help="Frames of each topic a second.")] = 30.0,
    insecure: Annotated[bool, typer.Option("--insecure", help="Serve to a network in clear.")] = False,
    overrides: Overrides = None,
) -> None:
    """Serve the running rig to Foxglove and other viewers of its protocol, to look at."""


@_verb("cli.arm:run_command", what="arm")
def arm(
    rig_name: Rig = "stub",
    address: Address = None,
    token: Token = None,
    fingerprint: Fingerprint = None,
    overrides: Overrides = None,
) -> None:
    """End a safe stop and try faulty devices again: the arms may push again."""


@_verb("cli.arm:run_command", "safe-stop", what="safe_stop")
def safe_stop(
    rig_name: Rig = "stub",
    address: Address = None,
    token: Token = None,
    fingerprint: Fingerprint = None,
    overrides: Overrides = None,
) -> None:
    """Let the arms go limp until the rig is armed again."""


@_verb("cli.make_keys:run_keys")
def keys(
    directory: Annotated[
        Path, typer.Argument(help="Made if it is not there; name it as transport.keys and supervisor.web.keys.")
    ],
    names: Annotated[
        list[str] | None,
        typer.Option("--name", help="Another name or address by which browsers reach the rig; may be given again."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Make the keys of a rig that spans hosts, and the certificate of its page; copy the directory to each host."""


@app.command()
def replay(
    file: Annotated[Path, typer.Argument(help="A recording.")],
    check: Annotated[bool, typer.Option("--check", help="Run without a rig and compare with the recording.")] = False,
    rate: Annotated[float, typer.Option(min=0.0, help="Multiple of real time; 0: as fast as possible.")] = 1.0,
    from_s: Annotated[float, typer.Option("--from", min=0.0, help="Second to begin at.")] = 0.0,
    until_s: Annotated[float | None, typer.Option("--until", min=0.001, help="Second to end at.")] = None,
    loop: Annotated[bool, typer.Option("--loop", help="Repeat without end.")] = False,
    take_over: Annotated[bool, typer.Option("--take-over", help="The rig's own devices take over at the end.")] = False,
    pictures: Annotated[bool, typer.Option("--pictures", help="Show what was recorded; simulate nothing.")] = False,
    rig: Rig = "stub",
    viewer: Annotated[Viewer | None, typer.Option(help="Where the picture is shown; default: as the rig says.")] = None,
    overrides: Overrides = None,
    json: Json = False,
) -> None:
    """Run a recording again: the same hands through the same physics, to the bit."""
    if check:
        from trocar.services.cli.replay import run_check

        return run_check(file, json)
    from trocar.services.supervisor.crew.fork_link import ForkServer

    with closing(ForkServer()) as fork_server:
        from trocar.services.cli.replay import ReplayRequest, run_replay

        shown = viewer and viewer.value
        asked = ReplayRequest(
            file, rig, rate, from_s, until_s, loop, take_over, pictures, shown, tuple(overrides or ())
        )
        return run_replay(asked, fork_server)


@_verb("cli.repair:run_repair")
def repair(
    files: Annotated[list[Path], typer.Argument(help="Recordings, mended in place.")], as_json: Json = False
) -> None:
    """Restore the index of recordings that a kill or a full disk cut off; the recorder does so at its start."""


@_verb("cli.scenes:run_scenes")
def scenes(as_json: Json = False) -> None:
    """List all scenes, each with one sentence."""


@_verb("cli.tissues:run_tissues")
def tissues(as_json: Json = False) -> None:
    """List the walls that a scene can name as `duct.tissue`: every value with its range and source."""


@_verb("cli.anatomy:run_anatomy")
def anatomy(
    file: Annotated[
        Path,
        typer.Argument(
            help="A labelled volume (.seg.nrrd, NRRD, NIfTI, MetaImage, DICOM-SEG) or a surface (STL, OBJ, PLY, VTP)."
        ),
    ],
    out: Annotated[Path | None, typer.Option(help="Folder to write; default: NAME-scene in this one.")] = None,
    label: Annotated[str | None, typer.Option(help="Name or number of the duct's label in a volume.")] = None,
    wall: Annotated[str | None, typer.Option(help="Label of the wall, from which its thickness is measured.")] = None,
    thickness_mm: Annotated[float | None, typer.Option(callback=finite, help="Of the wall.")] = None,
    surface_is: Annotated[
        SurfaceIs, typer.Option(help="What label or surface are: the lumen, or the middle of the wall.")
    ] = SurfaceIs.LUMEN,
    unit: Annotated[Unit, typer.Option(help="Of a surface's coordinates.")] = Unit.MM,
    axes: Annotated[
        Axes | None, typer.Option(help="Of a surface; default: as its file says (3D Slicer's do), else LPS.")
    ] = None,
    mouth: Annotated[
        str | None, typer.Option(help="End that the catheter enters: its name, or x,y,z in mm in LPS axes.")
    ] = None,
    held: Annotated[
        list[str] | None, typer.Option(help="End that is held; may be given again; default: all others.")
    ] = None,
    names: Annotated[
        list[str] | None, typer.Option("--name", metavar="END=NAME", help="Name an end; may be given again.")
    ] = None,
    edge_mm: Annotated[
        float | None, typer.Option(callback=finite, help="Edge of the shell's mesh; default: by the narrowest lumen.")
    ] = None,
    edit: Annotated[
        bool, typer.Option("--edit", help="Serve a page on which mouth, held ends, ports and goal are picked by mouse.")
    ] = False,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Of that page; 0: a free one.")] = 0,
    as_json: Json = False,
) -> None:
    """Make a scene from a segmentation or a surface of a patient: surface, scene file, picture, report."""


@_verb("cli.catheters:run_catheters")
def catheters(as_json: Json = False) -> None:
    """List the catheters and guide wires that a scene can name as `product`: every value with its range and source."""


@_verb("cli.attempt:run_scenarios")
def scenarios(as_json: Json = False) -> None:
    """List the scenarios that `trocar up --scenario` runs, each with its goal."""


@app.command()
def attempt(
    what: Annotated[
        AttemptVerb, typer.Argument(help="The order: new, pause, resume, step, slow, bookmark; `status` only looks.")
    ],
    value: Annotated[
        float | None,
        typer.Argument(min=0.0, callback=finite, help="`step`: whole milliseconds; `slow`: pace, 1/32 to 1."),
    ] = None,
    rig: Rig = "stub",
    json: Json = False,
    overrides: Overrides = None,
) -> None:
    """Restart the attempt, pause it, step through it, slow it down, or show its state."""
    from trocar.services.cli.attempt import run_order, run_status

    if what is AttemptVerb.STATUS:
        run_status(rig, tuple(overrides or ()), json)
    else:
        run_order(rig, tuple(overrides or ()), what.value, 1.0 if value is None else value)


@_verb("cli.show_config:run_show", "show", to=config_app)
def config_show(
    rig: Annotated[str | None, typer.Option(help="Rig file or name; the default.")] = None,
    scene: Annotated[str | None, typer.Option(help="Scene file or name.")] = None,
    device: Annotated[str | None, typer.Option(help="Device file or name.")] = None,
    origin: Annotated[bool, typer.Option("--origin", help="Where each value came from.")] = False,
    as_json: Json = False,
    overrides: Overrides = None,
) -> None:
    """Print a configuration with all its defaults."""


@_verb("cli.show_config:run_schema", "schema", to=config_app)
def config_schema(kind: Annotated[str, typer.Argument(help="rig, scene or device")] = "rig") -> None:
    """Print the JSON schema of a kind of file."""


@functools.cache
def add_installed_verbs() -> None:
    """Add the verbs of installed packages, once, that name a function (app) in the entry-point group `VERBS`.

    `services` imports neither what judges it nor what reviews its runs: they bring their verbs themselves.
    """
    for point in entry_points(group=VERBS):
        if find_spec(point.module.partition(".")[0]):  # an image of the rig leaves the studies out
            point.load()(app)


def main() -> None:
    """Run the command; what a person can mend is one sentence and an exit code."""
    add_installed_verbs()
    refusals.run(app)


if __name__ == "__main__":
    main()
