"""The `trocar` command: one verb per file, imported only when it is used, so that ``trocar --help`` is quick."""

from __future__ import annotations

import math
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from services.cli import refusals

app = typer.Typer(
    name="trocar", no_args_is_help=True, add_completion=True, pretty_exceptions_enable=False,
    help="Trocar: an open laparoscopic haptic trainer.",
)  # fmt: skip
config_app = typer.Typer(no_args_is_help=True, help="Show configuration, and what it may say.")
app.add_typer(config_app, name="config")

Rig = Annotated[str, typer.Option("--rig", envvar="TROCAR_RIG", help="Rig file, or the name of one in configs/rigs.")]
Scene = Annotated[
    str | None, typer.Option("--scene", envvar="TROCAR_SCENE", help="Scene file, or the name of one in configs/scenes.")
]
Overrides = Annotated[
    list[str] | None, typer.Option("--set", metavar="KEY=VALUE", envvar="TROCAR_SET", help="Change one key of the rig.")
]
Address = Annotated[str | None, typer.Option(help="Address of the supervisor's page; default: the one of this host.")]
Token = Annotated[str | None, typer.Option(help="Token that the rig printed, with --address.")]
Json = Annotated[bool, typer.Option("--json", help="One JSON object on standard output.")]


def _finite(value: float | None) -> float | None:
    """Refuse what has no end."""
    if value is not None and not math.isfinite(value):
        raise typer.BadParameter(f"{value} is no length of time")
    return value


class Viewer(StrEnum):
    """Where the picture is shown."""

    AUTO = "auto"
    NATIVE = "native"
    WEB = "web"
    NONE = "none"


@app.command()
def up(
    rig: Rig = "stub",
    scene: Scene = None,
    seconds: Annotated[
        float | None, typer.Option(min=0.1, callback=_finite, help="Run so long, measured from RUNNING, then end.")
    ] = None,
    json_file: Annotated[Path | None, typer.Option("--json", help="Write what the run did to this file.")] = None,
    viewer: Annotated[Viewer | None, typer.Option(help="Where the picture is shown; default: as the rig says.")] = None,
    overrides: Overrides = None,
) -> None:
    """Start the whole rig and stay with it until Ctrl-C."""
    from services.supervisor.nursery import Nursery

    with Nursery() as nursery:  # first: it imports on another core than all that follows
        from services.cli.up import Request, run_up

        run_up(Request(rig, scene, seconds, json_file, viewer and viewer.value, tuple(overrides or ())), nursery)


@app.command()
def down(rig: Rig = "stub", overrides: Overrides = None, json: Json = False) -> None:
    """End a rig that runs on this host, whatever is left of it."""
    from services.cli.down import run_down

    run_down(rig, tuple(overrides or ()), json)


@app.command()
def top(
    rig: Rig = "stub",
    once: Annotated[bool, typer.Option("--once", help="Print once and end.")] = False,
    json: Json = False,
    seconds: Annotated[float, typer.Option(min=0.3, callback=_finite, help="Window of the figures.")] = 2.0,
    overrides: Overrides = None,
) -> None:
    """Show rates, lateness, paths and topics of a running rig."""
    from services.cli.top import Request, run_top

    run_top(Request(rig, once, json, seconds, tuple(overrides or ())))


@app.command()
def latency(
    files: Annotated[
        list[Path] | None, typer.Argument(help="Files that the rig kept after missed ticks; without, the rig itself.")
    ] = None,
    rig: Rig = "stub",
    worst: Annotated[int, typer.Option(min=1, help="How many ticks to show.")] = 12,
    trace: Annotated[Path | None, typer.Option(help="Write a trace that ui.perfetto.dev opens.")] = None,
    json: Json = False,
    overrides: Overrides = None,
) -> None:
    """Show the worst ticks of the last seconds on one time line, and what had the core meanwhile."""
    from services.cli.latency import Request, run_latency

    run_latency(Request(tuple(files or ()), rig, worst, trace, json, tuple(overrides or ())))


@app.command()
def doctor(rig: Rig = "stub", overrides: Overrides = None, json: Json = False) -> None:
    """Check what this host can give the rig; exit code 1 where the rig cannot run."""
    from services.cli.doctor import run_doctor

    run_doctor(rig, tuple(overrides or ()), json)


@app.command()
def sniff(
    topic: Annotated[str | None, typer.Argument(help="Topic to print; without it, the rates of all.")] = None,
    rig: Rig = "stub",
    count: Annotated[int | None, typer.Option(min=1, help="End after so many frames.")] = None,
    seconds: Annotated[float | None, typer.Option(min=0.1, callback=_finite, help="End after so long.")] = None,
    hz: Annotated[
        bool, typer.Option("--hz", help="Rate, gaps and periods of the topic instead of its frames.")
    ] = False,
    every: Annotated[bool, typer.Option("--every", help="Print every frame, not five a second.")] = False,
    json: Json = False,
    overrides: Overrides = None,
) -> None:
    """Read the bus with plain msgpack: envelope and body of one topic, or the rates of all."""
    from services.cli.sniff import Request, run_sniff

    run_sniff(Request(rig, topic, count, seconds, hz, every, json, tuple(overrides or ())))


@app.command()
def arm(rig: Rig = "stub", address: Address = None, token: Token = None, overrides: Overrides = None) -> None:
    """End a safe stop, and try again what is at fault: the arms may push again."""
    from services.cli.arm import Access, run_command

    run_command("arm", rig, tuple(overrides or ()), Access(address, token or "") if address else None)


@app.command("safe-stop")
def safe_stop(rig: Rig = "stub", address: Address = None, token: Token = None, overrides: Overrides = None) -> None:
    """Let the arms go limp until the rig is armed anew."""
    from services.cli.arm import Access, run_command

    run_command("safe_stop", rig, tuple(overrides or ()), Access(address, token or "") if address else None)


@app.command()
def keys(
    directory: Annotated[Path, typer.Argument(help="Made if it is not there; name it as transport.keys.")],
    json: Json = False,
) -> None:
    """Make the keys of a rig that spans hosts: copy the directory to each of them."""
    from services.cli.make_keys import run_keys

    run_keys(directory, json)


@app.command()
def repair(
    files: Annotated[list[Path], typer.Argument(help="Recordings, mended in place.")], json: Json = False
) -> None:
    """Index recordings anew that a killed recorder left, or a full disk: the recorder does so itself at its start."""
    from services.cli.repair import run_repair

    run_repair(files, json)


@app.command()
def fem(
    file: Annotated[Path, typer.Argument(help="Shell case, see configs/fem.")],
    json_file: Annotated[Path | None, typer.Option("--json", help="Write numbers for programs.")] = None,
    vtu_file: Annotated[Path | None, typer.Option("--vtu", help="Write fields for ParaView.")] = None,
) -> None:
    """Solve your own shell: statics, frequencies, buckling of the case in a file."""
    from services.cli.fem import fem_command

    fem_command(file, json_file, vtu_file)


@app.command()
def effects(
    scene: Scene = None,
    measure: Annotated[
        bool, typer.Option("--measure", help="Run the scene with and without each effect; about a minute.")
    ] = False,
    json: Json = False,
) -> None:
    """List the physical effects: what each does, needs, and costs."""
    from services.cli.effects import run_effects

    run_effects(scene or "default", measure, json)


@app.command()
def tissues(json: Json = False) -> None:
    """List the walls that a scene can name as `duct.tissue`: every value with its range and source."""
    from services.cli.tissues import run_tissues

    run_tissues(json)


@app.command()
def stability(
    long: Annotated[
        bool, typer.Option("--long/--quick", help="All of every family, more than 2,000 runs; or a few of each.")
    ] = False,
    families: Annotated[
        list[str] | None, typer.Option("--family", metavar="NAME", help="Only this family; may be given again.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Other seeds, other members of the families.")] = 1,
    jobs: Annotated[int | None, typer.Option(min=1, help="Processes; default: one a core.")] = None,
    minutes: Annotated[
        float | None,
        typer.Option(
            min=0.0, callback=_finite, help="After so long begin no more cases, and tell of those that have run."
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder that keeps results as they come; a run that was ended goes on there.")
    ] = None,
    report: Annotated[Path | None, typer.Option(help="Write the table as a page, as docs/stability.md.")] = None,
    json: Json = False,
) -> None:
    """Run the hard cases: nothing blows up, nothing stays wrong, nothing lies quietly."""
    from services.cli.stability import Request, run_stability

    run_stability(Request(long, tuple(families or ()), seed, jobs, minutes, out, report, json))


@app.command()
def study(
    names: Annotated[list[str], typer.Argument(metavar="NAME", help="Studies, or all.")],
    quick: Annotated[bool, typer.Option("--quick", help="Fewer settings and samples: all in five minutes.")] = False,
    smallest: Annotated[bool, typer.Option("--smallest", help="So little that nothing can be learnt of it.")] = False,
    seed: Annotated[int, typer.Option(min=0, help="Draws what is drawn by chance.")] = 1,
    out: Annotated[
        Path, typer.Option(help="Folder for results, figures and page; a run that was ended goes on there.")
    ] = Path("study"),
    jobs: Annotated[int | None, typer.Option(min=1, help="Processes for errors; default: one a core.")] = None,
    scheduler: Annotated[
        str | None, typer.Option(help="Address of a Dask scheduler whose workers compute errors; costs stay here.")
    ] = None,
    report: Annotated[
        Path | None,
        typer.Option(
            help="Write a page with figures, as docs/accuracy.md; studies of it that are not run stay as they are."
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Show what accuracy costs in time: error against a converged reference beside the cost of a tick."""
    from services.cli.study import Request, run_study
    from services.studies.accuracy.study import Size

    if quick and smallest:
        raise typer.BadParameter("--quick and --smallest are two sizes: say one of them")
    size = Size.SMALLEST if smallest else Size.QUICK if quick else Size.FULL
    run_study(Request(tuple(names), size, seed, out, jobs, scheduler, report, json))


@app.command()
def tune(
    scene: Annotated[str, typer.Option("--scene", help="Scene file, or the name of one in configs/scenes.")],
    budget_us: Annotated[
        float | None,
        typer.Option(help="What a tick of physics may cost, in microseconds; without it, only the ladder is measured."),
    ] = None,
    overrides: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Change one key of the scene first.")
    ] = None,
    out: Annotated[Path, typer.Option(help="Scene file to write, with its quality ladder.")] = Path("tuned.yaml"),
    json: Json = False,
) -> None:
    """Choose modes, mesh, particles, sweeps and effects of a scene for this machine, and say what was given up."""
    from services.cli.tune import Request, run_tune

    run_tune(Request(scene, tuple(overrides or ()), budget_us, out, json))


@app.command()
def haptics(
    hands: Annotated[int, typer.Option(min=1, help="How many try to get energy out of each kind of servo.")] = 1000,
    out: Annotated[Path, typer.Option(help="Page to write; its figures go into a folder beside it.")] = Path(
        "haptics.md"
    ),
    running: Annotated[
        bool, typer.Option("--running", help="First run an insertion in a rig of its own; else keep what one did.")
    ] = False,
    json: Json = False,
) -> None:
    """Show what is felt: how stiff a wall may be, what a moving hand meets, whether any hand gets energy out."""
    from services.cli.haptics import Request, run_haptics

    run_haptics(Request(hands, out, json, running))


@config_app.command("show")
def config_show(
    rig: Annotated[str | None, typer.Option(help="Rig file or name; the default.")] = None,
    scene: Annotated[str | None, typer.Option(help="Scene file or name.")] = None,
    device: Annotated[str | None, typer.Option(help="Device file or name.")] = None,
    origin: Annotated[bool, typer.Option("--origin", help="Where each value came from.")] = False,
    json: Json = False,
    overrides: Overrides = None,
) -> None:
    """Print a configuration with all its defaults."""
    from services.cli.show_config import Request, run_show

    run_show(Request(rig, scene, device, origin, json, tuple(overrides or ())))


@config_app.command("schema")
def config_schema(kind: Annotated[str, typer.Argument(help="rig, scene or device")] = "rig") -> None:
    """Print the JSON schema of a kind of file."""
    from services.cli.show_config import run_schema

    run_schema(kind)


def main() -> None:
    """Run the command; what a person can mend is one sentence and an exit code."""
    refusals.run(app)


if __name__ == "__main__":
    main()
