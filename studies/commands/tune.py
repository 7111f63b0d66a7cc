"""``trocar tune``: the settings of a scene that fit a budget on this machine, and what was given up for it."""

from __future__ import annotations

import json
import math
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import yaml
from rich.console import Console
from rich.table import Table

from trocar.services.cli import targets
from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.scene import QualityLevel, SceneModel
from trocar.services.runtime.config import config
from trocar.services.runtime.errors import ConfigError
from trocar.services.scenes import load_duct, load_scene, load_surface
from trocar.services.scenes.hands import hands_of
from trocar.studies.accuracy.insertions import TICK_S
from trocar.studies.accuracy.study import Tick
from trocar.studies.accuracy.trial import HELD_AT, Run, Trial
from trocar.studies.accuracy.tuning import Rung, Tuned, count_runs, measure_ladder, tune, value_of
from trocar.studies.commands.progress_bar import in_words, progress_line
from trocar.studies.progress import Tell

_CHOSEN = ("duct.n_modes", "catheter.n_segments", "catheter.integrator")
_CELLS = ("duct.n_around", "duct.n_along")
_USUAL_TICK_US = 400.0
"""Of a scene whose ladder was never measured."""
_AS_EVER = asdict(QualityLevel())


@dataclass(frozen=True)
class Request:
    """What was asked for on the command line."""

    scene: str
    overrides: tuple[str, ...]
    budget_us: float | None
    out: Path
    json: bool


def run_tune(request: Request) -> None:
    """Tune a scene, print what was given up for what, and write it with its quality ladder.

    Raises ConfigError if the scene, the budget or the name of the file cannot be used. Raises UserError: what was found
    is printed, but cannot be written.
    """
    scene = _checked(request)
    tuned = _tuned(scene, request.budget_us)
    if request.json:
        print(json.dumps(_as_data(tuned)))
    else:
        _print(request, tuned)
    targets.write_text("--out", request.out, tuned_text(request, tuned))
    if not request.json:
        Console(soft_wrap=True).print(f"Written: {request.out}", markup=False, highlight=False)


def _checked(request: Request) -> SceneModel:
    if request.budget_us is not None and not (math.isfinite(request.budget_us) and request.budget_us > 0.0):
        raise ConfigError(f"--budget-us must be a positive number of microseconds, is {request.budget_us:g}")
    if request.out.suffix not in (".yaml", ".yml"):
        raise ConfigError(f"--out {request.out}: a scene file ends in .yaml")
    scene = load_scene(request.scene, request.overrides)
    if scene.duct_alone:
        raise ConfigError(f"scene {request.scene}: names but a duct; tuning needs tools that feel something")
    if not scene.forceps:
        raise ConfigError(f"scene {request.scene}: forceps: has none, and without a tool nothing is felt")
    if scene.hands == "none":
        raise ConfigError(
            f"scene {request.scene}: hands: with none nothing is felt that a setting could be judged by; "
            "name others for this with --set hands=pinch"
        )
    targets.look_at_file("--out", request.out, makes_folder=True)
    return scene


def _tuned(scene: SceneModel, budget_us: float | None) -> Tuned:
    expected = in_words(expected_s(scene, budget_us))
    print(
        f"trocar: tuning takes {expected} or so on a quiet machine; bases and kernels that are new add to it",
        file=sys.stderr,
    )
    with progress_line() as tell:
        trial = CountedTrial(tell, count_runs(scene, is_walk=budget_us is not None))
        if budget_us is None:
            return measure_ladder(scene, trial, trial.take_part)
        return tune(scene, budget_us, trial, trial.take_part)


class CountedTrial(Trial):
    """Tells how much of all runs is done, whatever part of the tuning they belong to."""

    def __init__(self, tell: Tell, n_runs: float) -> None:
        directory = cache_directory()
        super().__init__(lambda each: load_duct(each, directory, lambda *_: None))
        self._tell, self._n_runs, self._done, self._part = tell, n_runs, 0.0, ""

    def run(self, scene: SceneModel, dt_s: float = TICK_S, level: int = 0) -> Run:
        """Return what comes of a scene's own hands."""
        run = super().run(scene, dt_s, level)
        self._count(TICK_S / dt_s)
        return run

    def tick(self, scene: SceneModel, level: int = 0, dt_s: float = TICK_S) -> Tick:
        """Return a millisecond of a scene, most of what its hands do being done."""
        tick = super().tick(scene, level, dt_s)
        self._count(HELD_AT)
        return tick

    def take_part(self, part: str, _done: int, _total: int) -> None:
        """Take what the runs that follow are for."""
        self._part = part
        self._count(0.0)

    def _count(self, runs: float) -> None:
        self._done = min(self._done + runs, self._n_runs)
        self._tell(self._part, round(self._done), round(self._n_runs))


def expected_s(scene: SceneModel, budget_us: float | None) -> float:
    """Return roughly how long tuning takes, by what a tick cost when the scene's ladder was last measured."""
    tick_s = 1e-6 * (scene.quality[0].cost_us or _USUAL_TICK_US)
    hands = hands_of(scene, load_surface(scene, cache_directory()))
    return count_runs(scene, is_walk=budget_us is not None) * tick_s * hands.duration_s / TICK_S


def tuned_text(request: Request, tuned: Tuned) -> str:
    """Return the scene file: what the scene's own says, with what was chosen and the ladder."""
    path, scene, last = config.find("scene", request.scene), tuned.scene, tuned.rungs[-1]
    data: dict[str, Any] = config.read_yaml(path)
    config.apply_overrides(data, request.overrides, {})
    if scene.duct.mesh_file is None:
        chosen = (*_CELLS, *_CHOSEN)
    else:
        data["duct"]["mesh_file"] = str(Path(scene.duct.mesh_file).absolute())
        chosen = (*(("duct.mesh_edge_m",) if scene.duct.mesh_edge_m is not None else ()), *_CHOSEN)
    for key in chosen:
        part, _, field = key.partition(".")
        data.setdefault(part, {})[field] = value_of(scene, key)
    data["effects"] = {name: each for name, each in data.get("effects", {}).items() if name in scene.effects}
    data["quality"] = [_level(asdict(level)) for level in tuned.ladder]
    given = ", ".join(step.name for step in last.steps) or "nothing"
    asked = "" if request.budget_us is None else f" --budget-us {request.budget_us:g}"
    head = (
        f"{path.stem} as `trocar tune{asked}` left it on one machine: a tick of "
        f"{last.cost.median_us:.0f} us, forces {last.errors.force_percent:.2g} % and motion "
        f"{last.errors.motion_percent:.2g} % from the finest that was tried.\nGiven up for it: {given}."
    )
    return "".join(f"# {line}\n" for line in head.splitlines()) + yaml.safe_dump(data, sort_keys=False)


def _level(level: dict[str, Any]) -> dict[str, Any]:
    told = {key: value for key, value in level.items() if key == "name" or value != _AS_EVER[key]}
    return {key: list(value) if isinstance(value, tuple) else value for key, value in told.items()}


def _as_data(tuned: Tuned) -> dict[str, Any]:
    rungs = [
        {"steps": [step.name for step in rung.steps], "cost": asdict(rung.cost), "errors": asdict(rung.errors)}
        for rung in tuned.rungs
    ]
    return {"fits": tuned.fits, "rungs": rungs, "ladder": [asdict(level) for level in tuned.ladder]}


def _print(request: Request, tuned: Tuned) -> None:
    console = Console(highlight=False)
    console.print(_rungs_table(tuned))
    console.print("Ladder while it runs:")
    for level in tuned.ladder:
        off = f"force off by {level.force_error_percent:g} %, motion by {level.motion_error_percent:g} %"
        console.print(f"  {level.name}: {level.cost_us:g} us, {off}")
    if not tuned.fits:
        console.print(f"[bold]Nothing that may be given up brings a tick to {request.budget_us:g} us.[/]")


def _rungs_table(tuned: Tuned) -> Table:
    table = Table(box=None, pad_edge=False)
    for title in ("given up", "us a tick", "99 %", "noise", "freed", "force off by", "motion off by"):
        table.add_column(title, overflow="fold")
    before: Rung | None = None
    for rung in tuned.rungs:
        freed = f"{before.cost.median_us - rung.cost.median_us:+.0f} us" if before else ""
        cost = (f"{rung.cost.median_us:.0f}", f"{rung.cost.p99_us:.0f}", f"{rung.cost.noise_us:.0f}")
        errors = (f"{rung.errors.force_percent:.2g} %", f"{rung.errors.motion_percent:.2g} %")
        table.add_row(rung.steps[-1].name if rung.steps else "nothing", *cost, freed, *errors)
        before = rung
    return table
