"""Verbs of the `trocar` command that review runs; each imports what it needs when it is used."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from trocar.review.export.views import FilmView
from trocar.services.cli.options import Json, Overrides, Rig, Scene
from trocar.services.cli.plain_help import PlainTyper
from trocar.services.runtime.errors import ConfigError

Rules = Annotated[str, typer.Option(help="Rules of the score: a file, or the name of one in configs/scores.")]
Experts = Annotated[Path | None, typer.Option(help="Reference attempts, as `trocar attempts export` writes them.")]
Database = Annotated[
    str | None,
    typer.Option(envvar="TROCAR_ATTEMPTS", help="File or address of the database; default: a file of this user."),
]


class Form(StrEnum):
    """What a recording may be exported to."""

    CSV = "csv"
    PARQUET = "parquet"
    NPZ = "npz"
    MP4 = "mp4"
    LEROBOT = "lerobot"


class DatasetLayout(StrEnum):
    """Versions of LeRobot's layout."""

    V3 = "v3.0"
    V2 = "v2.1"


attempts_app = PlainTyper(no_args_is_help=True, help="What was kept of trainees: list, curve, export, xapi, erase.")


def add_to(app: typer.Typer) -> None:
    """Add the verbs to the command: the entry point ``trocar.verbs`` of `pyproject.toml`."""
    for verb in (classroom, export, score, report, settings):
        app.command()(verb)
    app.add_typer(attempts_app, name="attempts")


def classroom(
    file: Annotated[
        Path, typer.Argument(help="TOML: `token`, and of each `[[rig]]` `name`, `address`, `fingerprint`, `trainee`.")
    ],
    host: Annotated[str, typer.Option(help="Address to serve at.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535)] = 8090,
) -> None:
    """Show many rigs on one page: state, trainee, phase, last score, late or not, a picture on demand."""
    from trocar.review.classroom.app import serve

    serve(file, host, port)


def export(
    files: Annotated[list[Path], typer.Argument(help="A recording; for LeRobot, any number.")],
    to: Annotated[
        Form,
        typer.Option("--to", help="Tables (csv, parquet), arrays (npz), a film (mp4) or a LeRobot dataset (lerobot)."),
    ],
    out: Annotated[
        Path | None, typer.Option(help="File, or folder of tables or of a dataset; default: beside the recording.")
    ] = None,
    topics: Annotated[list[str] | None, typer.Option("--topic", help="Only this topic; may be given again.")] = None,
    view: Annotated[
        FilmView, typer.Option(help="View of a film: the endoscope's, X-ray, or with contrast.")
    ] = FilmView.SCOPE,
    fps: Annotated[int, typer.Option(min=1, max=1000, help="LeRobot: moments a second.")] = 50,
    film: Annotated[bool, typer.Option(help="LeRobot: with pictures of the view.")] = False,
    task: Annotated[str, typer.Option(help="LeRobot: what was done, in words; default: the scenario's title.")] = "",
    layout: Annotated[DatasetLayout, typer.Option(help="LeRobot: version of its layout.")] = DatasetLayout.V3,
) -> None:
    """Write what a recording holds as tables with a column for each number, as arrays, a film or a dataset."""
    from trocar.review.commands.export import export_dataset, run_export

    if to is Form.LEROBOT:
        export_dataset(files, out, fps=fps, view=view if film else None, task=task, layout=layout)
    elif len(files) > 1:
        raise ConfigError(f"--to {to}: takes one recording at a time, and {len(files)} are named")
    else:
        run_export(files[0], to, out, topics or (), view)


def settings(
    rig: Rig = "stub",
    scene: Scene = None,
    overrides: Overrides = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port of the page; 0: a free one.")] = 8070,
) -> None:
    """Edit files of rigs, scenes and devices on a page, checked before they are saved, also where no rig starts."""
    from trocar.review.settings.page import serve

    serve(rig, scene or "default", overrides or (), port)


def score(
    file: Annotated[Path, typer.Argument(help="A recording.")],
    scenario: Annotated[str | None, typer.Option(help="Scenario to judge by; default: the recording's.")] = None,
    rules: Rules = "mistels",
    experts: Experts = None,
    trainee: Annotated[str | None, typer.Option(help="Keep the attempts as this trainee's, by pseudonym.")] = None,
    database: Database = None,
    json: Json = False,
) -> None:
    """Judge the attempts in a recording: phases, errors, metrics and score."""
    from trocar.review.commands.score import run_score

    run_score(file, scenario, rules, experts, trainee, database, json)


def report(
    what: Annotated[str, typer.Argument(metavar="FILE|NUMBER", help="A recording, or an attempt that was kept.")],
    out: Annotated[Path | None, typer.Option(help="The file to write.")] = None,
    attempt: Annotated[int, typer.Option(help="Number in the recording, from 1; -1: the last; 0: all.")] = 0,
    scenario: Annotated[str | None, typer.Option(help="Scenario to judge by; default: the recording's.")] = None,
    rules: Rules = "mistels",
    experts: Experts = None,
    database: Database = None,
    page: Annotated[str, typer.Option(help="Address of the page that opens replays.")] = "http://localhost:8080/",
) -> None:
    """Write one HTML file about an attempt: what went wrong and when, and what to practise next."""
    from trocar.review.commands.report import ReportRequest, run_report

    run_report(ReportRequest(what, out, attempt, scenario, rules, experts, database, page))


@attempts_app.command("list")
def attempts_list(
    trainee: Annotated[str | None, typer.Option(help="Only this trainee's.")] = None,
    scenario: Annotated[str | None, typer.Option(help="Only this scenario.")] = None,
    database: Database = None,
    json: Json = False,
) -> None:
    """List the stored attempts."""
    from trocar.review.commands.attempts import run_list

    run_list(database, trainee, scenario, json)


@attempts_app.command("curve")
def attempts_curve(
    trainee: Annotated[str, typer.Argument(help="Pseudonym.")],
    scenario: Annotated[str, typer.Argument(help="Name of the scenario.")],
    rules: Rules = "mistels",
    database: Database = None,
    json: Json = False,
) -> None:
    """Show how a trainee learns: times, scores, and CUSUM of failures."""
    from trocar.review.commands.attempts import run_curve

    run_curve(database, trainee, scenario, rules, json)


@attempts_app.command("export")
def attempts_export(
    trainee: Annotated[str | None, typer.Argument(help="Pseudonym; default: all trainees.")] = None,
    out: Annotated[
        Path | None, typer.Option(help="The file to write, .csv for a table of metrics; default: standard output.")
    ] = None,
    database: Database = None,
) -> None:
    """Write all data of a trainee as JSON, which `trocar score --experts` reads."""
    from trocar.review.commands.attempts import run_export

    run_export(database, trainee, out)


@attempts_app.command("xapi")
def attempts_xapi(
    to: Annotated[str, typer.Argument(help="A file, or the address of a learning record store's statements.")],
    trainee: Annotated[str | None, typer.Option(help="Only this trainee's.")] = None,
    home: Annotated[
        str, typer.Option(help="Address of yours under which your pseudonyms and scenarios are known.")
    ] = "http://localhost",
    login: Annotated[str, typer.Option(envvar="TROCAR_XAPI_LOGIN", help="NAME:PASSWORD; better in the variable.")] = "",
    database: Database = None,
) -> None:
    """Send attempts as xAPI statements; what was sent before is the same statement, which a store keeps once."""
    from trocar.review.commands.attempts import run_xapi

    run_xapi(database, trainee, to, home, login)


@attempts_app.command("erase")
def attempts_erase(
    trainee: Annotated[str, typer.Argument(help="Pseudonym.")],
    recordings: Annotated[
        bool, typer.Option("--recordings", help="Delete the recordings, too, but those shared with other trainees.")
    ] = False,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask.")] = False,
    database: Database = None,
    json: Json = False,
) -> None:
    """Delete a trainee and all attempts, once you have agreed."""
    from trocar.review.commands.attempts import run_erase

    run_erase(database, trainee, recordings, yes, json)
