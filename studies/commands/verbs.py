"""Verbs of the `trocar` command that judge; each imports what it needs when it is used."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from trocar.services.cli.options import Json, Scene, finite


def add_to(app: typer.Typer) -> None:
    """Add the verbs to the command: the entry point ``trocar.verbs`` of `pyproject.toml`."""
    for verb in (fem, effects, stability, study, tune, haptics):
        app.command()(verb)


def fem(
    file: Annotated[Path, typer.Argument(help="Shell case, see configs/fem.")],
    json_file: Annotated[Path | None, typer.Option("--json", help="Write numbers for programs.")] = None,
    vtu_file: Annotated[Path | None, typer.Option("--vtu", help="Write fields for ParaView.")] = None,
    inp_file: Annotated[Path | None, typer.Option("--inp", help="Write the case for CalculiX.")] = None,
    by_calculix: Annotated[
        bool, typer.Option("--calculix", help="Solve it by CalculiX, too, and compare both solutions.")
    ] = False,
) -> None:
    """Solve your own shell: statics, frequencies, buckling of the case in a file."""
    from trocar.studies.commands.fem import fem_command

    fem_command(file, json_file, vtu_file, inp_file, by_calculix=by_calculix)


def effects(
    scene: Scene = None,
    measure: Annotated[
        bool, typer.Option("--measure", help="Run the scene with and without each effect; about a minute.")
    ] = False,
    json: Json = False,
) -> None:
    """List the physical effects: what each does, needs, and costs."""
    from trocar.studies.commands.effects import run_effects

    run_effects(scene or "default", measure, json)


def stability(
    long: Annotated[
        bool, typer.Option("--long/--quick", help="Run all cases, more than 2,000; default: a few of each family.")
    ] = False,
    families: Annotated[
        list[str] | None, typer.Option("--family", metavar="NAME", help="Only this family; may be given again.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed by which the cases are drawn.")] = 1,
    most: Annotated[
        int | None, typer.Option(min=1, help="At most so many cases of each family, drawn by the seed.")
    ] = None,
    cases: Annotated[
        int | None, typer.Option(min=1, help="So many cases of the family `drawn`; default: 12, or 200 of all.")
    ] = None,
    jobs: Annotated[int | None, typer.Option(min=1, help="Processes; default: one a core.")] = None,
    minutes: Annotated[
        float | None,
        typer.Option(min=0.0, callback=finite, help="Start no case after so many minutes."),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for results; an interrupted run continues there.")] = None,
    report: Annotated[
        Path | None, typer.Option(help="Write the table as a page, as docs/results/stability.md.")
    ] = None,
    others: Annotated[
        list[Path] | None,
        typer.Option("--and", metavar="FOLDER", help="Add the results of another seed in --out to the page."),
    ] = None,
    against: Annotated[
        Path | None, typer.Option(help="Compare with a file that another revision wrote with --json.")
    ] = None,
    json: Json = False,
) -> None:
    """Run hard cases, each judged by limits of energy, overlap, force and rest."""
    from trocar.studies.commands.stability import Request, run_stability

    files = out, report, tuple(others or ()), against
    run_stability(Request(long, tuple(families or ()), seed, most, cases, jobs, minutes, *files, json))


def study(
    names: Annotated[
        list[str] | None, typer.Argument(metavar="NAME", help="Studies, or all; without one, they are listed.")
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Fewer settings and samples: all in five minutes.")] = False,
    smallest: Annotated[bool, typer.Option("--smallest", help="The smallest run, to try it out.")] = False,
    seed: Annotated[int, typer.Option(min=0, help="Seed of all random choices.")] = 1,
    out: Annotated[
        Path, typer.Option(help="Folder for results, figures and page; an interrupted run continues there.")
    ] = Path("study"),
    jobs: Annotated[int | None, typer.Option(min=1, help="Processes for errors; default: one a core.")] = None,
    scheduler: Annotated[
        str | None, typer.Option(help="Address of a Dask scheduler whose workers compute errors; costs stay here.")
    ] = None,
    report: Annotated[
        Path | None,
        typer.Option(
            help="Write a page with figures, as docs/results/accuracy.md; its other studies stay as they are."
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Measure what accuracy costs: error against a converged reference, and time of a tick."""
    from trocar.studies.accuracy.study import Size
    from trocar.studies.commands.study import Request, run_study

    if quick and smallest:
        raise typer.BadParameter("--quick and --smallest are two sizes: say one of them")
    size = Size.SMALLEST if smallest else Size.QUICK if quick else Size.FULL
    run_study(Request(tuple(names or ()), size, seed, out, jobs, scheduler, report, json))


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
    from trocar.studies.commands.tune import Request, run_tune

    run_tune(Request(scene, tuple(overrides or ()), budget_us, out, json))


def haptics(
    hands: Annotated[int, typer.Option(min=1, help="Hands that try to gain energy, for each servo law.")] = 1000,
    out: Annotated[Path, typer.Option(help="Page to write; its figures go into a folder beside it.")] = Path(
        "haptics.md"
    ),
    running: Annotated[
        bool, typer.Option("--running", help="First run an insertion in a rig; default: keep the last results.")
    ] = False,
    json: Json = False,
) -> None:
    """Measure the haptics: how stiff a wall may be, what a moving hand feels, whether a hand can gain energy."""
    from trocar.studies.commands.haptics import Request, run_haptics

    run_haptics(Request(hands, out, json, running))
