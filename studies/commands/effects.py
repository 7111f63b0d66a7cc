"""``trocar effects``: every physical effect, what it does, its settings, and what it costs here."""

from __future__ import annotations

import inspect
import json
from dataclasses import MISSING, asdict, dataclass, fields
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.effects import EFFECTS
from trocar.services.mechanics.scene import SceneModel
from trocar.services.runtime.errors import ConfigError
from trocar.services.scenes import load_duct, load_scene
from trocar.studies.commands.progress_bar import progress_line
from trocar.studies.effect_costs import EffectCost, measure_effect


@dataclass(frozen=True)
class EffectLine:
    """One effect as the table of effects, its settings and its own words describe it."""

    name: str
    what: str
    law: str
    settings: dict[str, Any]
    stages: tuple[str, ...]
    in_scene: bool
    cost: EffectCost | None = None


def run_effects(scene_name: str, measure: bool, as_json: bool) -> None:
    """Print all effects as seen from a scene; measure what each costs in it where asked."""
    scene = load_scene(scene_name)
    costs = _measure(scene_name, scene) if measure else {}
    lines = [describe(name, scene, costs.get(name)) for name in EFFECTS]
    if as_json:
        print(json.dumps({"scene": scene_name, "effects": [asdict(line) for line in lines]}, indent=1, default=str))
    else:
        _print(lines)


def describe(name: str, scene: SceneModel, cost: EffectCost | None = None) -> EffectLine:
    """Read an effect's row, settings and docstring."""
    entry = EFFECTS[name]
    settings = {f.name: f.default if f.default is not MISSING else "required" for f in fields(entry.kind.Settings)}
    if name in scene.effects:
        settings = {key: getattr(scene.effects[name], key) for key in settings}
    return EffectLine(
        name=name,
        what=entry.what,
        law=(inspect.getdoc(entry.kind) or "").partition("\n\n")[0],
        settings=settings,
        stages=entry.stages,
        in_scene=name in scene.effects,
        cost=cost,
    )


def _measure(scene_name: str, scene: SceneModel) -> dict[str, EffectCost]:
    costs = {}
    directory = cache_directory()
    with progress_line() as tell:
        for done, name in enumerate(EFFECTS):
            tell(f"measuring {name}", done, len(EFFECTS))
            try:
                costs[name] = measure_effect(name, scene, lambda each: load_duct(each, directory, lambda *_: None))
            except ValueError as error:
                raise ConfigError(f"scene {scene_name}: {error}") from error
    return costs


def _print(lines: list[EffectLine]) -> None:
    measured = any(line.cost is not None for line in lines)
    table = Table(box=None, pad_edge=False)
    for title in ("", "effect", "what it is", "settings", "acts in", *(("us a step",) if measured else ())):
        table.add_column(title, overflow="fold", no_wrap=title == "effect")
    for line in lines:
        settings = [f"{key} = {_short(value)}" for key, value in line.settings.items()]
        cells = [line.name, line.what, "\n".join(settings) or "none", ", ".join(line.stages)]
        if line.cost is not None:
            cells.append(f"{line.cost.extra_us:+.0f} (noise {abs(line.cost.noise_us):.0f})")
        table.add_row("[green]on[/]" if line.in_scene else "", *map(escape, cells))
    console = Console(highlight=False)
    console.print(table)
    if measured:
        step_us = next(line.cost.step_us for line in lines if line.cost is not None)
        console.print(f"Added to a step of {step_us:.0f} us, with the hands of the insertion; medians of this run.")
    else:
        console.print("--measure runs the scene with and without each effect and adds what it costs on this machine.")


def _short(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
