"""``trocar haptics``: how good the haptics is, as a page with figures."""

from __future__ import annotations

import json
import os
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from pathlib import Path

from rich.console import Console

import services.runtime  # noqa: F401 - keeps linear algebra to one thread before numpy is loaded
from services.cache_directory import cache_directory
from services.cli import targets
from services.cli.progress import progress_line
from services.gateway.feel.figures import draw_borders, draw_energies, draw_transparency
from services.gateway.feel.late import answer_late, solve
from services.gateway.feel.measure import energies, passive_borders, stable_borders, transparency
from services.gateway.feel.report import Felt, write_page
from services.studies.accuracy.facts import Facts
from services.studies.accuracy.study import Draw, Size
from services.studies.provenance import code_version


@dataclass(frozen=True)
class Request:
    """What was asked for on the command line."""

    hands: int
    out: Path
    json: bool


def run_haptics(request: Request) -> None:
    """Measure what is felt and write the page, with its figures in a folder beside it.

    Raises
    ------
    ConfigError
        A page in a folder that is not there, or that is closed to this user.
    UserError
        The disk is full.
    """
    targets.look_at_file("--out", request.out)
    figures = request.out.absolute().parent / request.out.stem
    targets.make_folder("--out", figures)
    with progress_line() as tell, ProcessPoolExecutor(os.cpu_count(), get_context("spawn")) as executor:
        late = answer_late(solve(cache_directory() / "bases"))
        felt = Felt(passive_borders(), stable_borders(), transparency(), energies(request.hands, executor, tell), late)
    draw = Draw(Size.FULL, 0)
    facts = Facts.collect(f"trocar haptics --hands {request.hands}", code_version(Path(__file__).parents[2]), draw, {})
    if request.json:
        print(json.dumps({"page": str(request.out), **_data(felt)}))
    with targets.writing("--out", request.out):
        draw_borders(felt.passive, felt.stable, figures / "borders")
        draw_transparency(felt.rendered, figures / "transparency")
        draw_energies(felt.energies, figures / "energies")
        write_page(felt, facts.lines(), figures, request.out)
    if not request.json:
        Console().print(f"written to {request.out}, figures in {figures}", soft_wrap=True)


def _data(felt: Felt) -> dict[str, object]:
    return {
        "worst_border": felt.worst_border(),
        "energies": [
            {
                "kind": each.kind,
                "gaining": each.gaining,
                "worst_j": each.worst_j,
                "books": [asdict(b) for b in each.books],
            }
            for each in felt.energies
        ],
    }
