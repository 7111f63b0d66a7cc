"""``trocar haptics``: how good the haptics is, as a page with figures.

What running processes do is kept beside the figures, and is on the page until it is measured anew.
"""

from __future__ import annotations

import json
import os
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path

import msgspec
from msgspec.structs import replace
from rich.console import Console

from trocar.services.cli import targets
from trocar.services.files.cache_directory import cache_directory
from trocar.services.runtime.errors import ConfigError
from trocar.services.scenes import load_scene
from trocar.studies.accuracy.facts import Facts
from trocar.studies.accuracy.study import Draw, Size
from trocar.studies.commands.progress_bar import progress_line
from trocar.studies.commands.running_insertion import SCENE, run_insertion
from trocar.studies.feel.compare import compare
from trocar.studies.feel.figures import draw_borders, draw_energies, draw_transparency
from trocar.studies.feel.late import answer_late, solve
from trocar.studies.feel.measure import (
    energies,
    hunts,
    passive_borders,
    slow_rows,
    stable_borders,
    told_rows,
    transparency,
)
from trocar.studies.feel.passivity_cost import passivity_costs
from trocar.studies.feel.report import Felt, write_page
from trocar.studies.feel.tracking import Running, find_running
from trocar.studies.feel.z_width import z_widths
from trocar.studies.pool import open_pool
from trocar.studies.provenance import code_version

RUNNING = "running.json"


@dataclass(frozen=True)
class Request:
    """What was asked for on the command line."""

    hands: int
    out: Path
    json: bool
    running: bool = False


def run_haptics(request: Request) -> None:
    """Measure what is felt and write the page, with its figures in a folder beside it.

    Raises ConfigError: a page in a folder that cannot be made, or that is closed to this user. Raises UserError: the
    disk is full.
    """
    figures = targets.make_figures_folder("--out", request.out)
    running = read_running(figures / RUNNING) if not request.running else None
    command = f"trocar haptics --hands {request.hands}{' --running' * request.running}"
    facts = Facts.collect(command, code_version(Path(__file__).parents[2]), Draw(Size.FULL, 0), {})
    if request.running:
        running = _measure_running(figures / RUNNING, facts.lines())
    with progress_line() as tell, open_pool(os.cpu_count() or 1) as executor:
        late = answer_late(solve(cache_directory() / "bases"))
        won = energies(request.hands, executor, tell)
        hunted, slow = hunts(request.hands, executor, tell), slow_rows(request.hands // 2)
    compared = compare(max(40, request.hands // 4))
    widths, told = z_widths(max(40, request.hands // 4)), told_rows(request.hands // 2)
    costs = list(passivity_costs(max(40, request.hands // 2)))
    felt = Felt(
        passive_borders(),
        stable_borders(),
        transparency(),
        won,
        late,
        hunted,
        slow,
        running,
        compared,
        widths,
        told,
        costs,
    )
    if request.json:
        print(json.dumps({"page": str(request.out), **_data(felt)}))
    with targets.writing("--out", request.out):
        draw_borders(felt.passive, felt.stable, figures / "borders")
        draw_transparency(felt.rendered, figures / "transparency")
        draw_energies(felt.energies, figures / "energies")
        write_page(felt, facts.lines(), figures, request.out)
    if not request.json:
        Console().print(f"written to {request.out}, figures in {figures}", soft_wrap=True)


def _measure_running(file: Path, made_with: list[str]) -> Running:
    """Run the insertion in a rig, alone on the machine; keep what it did, and return it."""
    with tempfile.TemporaryDirectory(prefix="trocar-haptics-") as folder:
        said, solved = run_insertion(Path(folder))
    found = find_running(said, solved, load_scene(SCENE), cache_directory() / "bases")
    found = replace(found, made_with=tuple(made_with))
    targets.write_text("--out", file, msgspec.json.encode(found).decode())
    return found


def read_running(file: Path) -> Running | None:
    """Return what running processes were last seen to do, None if nobody has looked.

    Raises ConfigError if the file is not one of ours.
    """
    if not file.exists():
        return None
    try:
        return msgspec.json.decode(file.read_bytes(), type=Running)
    except msgspec.DecodeError as error:
        raise ConfigError(f"{file}: {error}; `trocar haptics --running` writes it anew") from None


def _data(felt: Felt) -> dict[str, object]:
    return {
        "worst_border": felt.worst_border(),
        "hunted": [asdict(each) for each in felt.hunted],
        "slow": [asdict(each) for each in felt.slow],
        "compared": [asdict(each) for each in felt.compared],
        "z_widths": [asdict(each) for each in felt.z_widths],
        "costs": [asdict(each) for each in felt.costs],
        "told": [{"factor": factor, **asdict(each)} for factor, each in felt.told],
        "running": None if felt.running is None else msgspec.to_builtins(felt.running),
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
