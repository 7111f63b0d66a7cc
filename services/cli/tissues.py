"""``trocar tissues``: walls that a scene can name, every value with its range and source."""

from __future__ import annotations

import json
from dataclasses import asdict

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from trocar.services.cli.value_table import ValueRow, value_table
from trocar.services.mechanics.scene.tissue import DUCH_DISTENSION, TISSUES, Distension, Tissue


def run_tissues(as_json: bool) -> None:
    """Print all presets."""
    if as_json:
        said = {name: {key: asdict(q) for key, q in preset.quantities().items()} for name, preset in TISSUES.items()}
        print(json.dumps({"tissues": said, "distension": distensions()}, indent=1))
        return
    console = Console(highlight=False)
    for name, preset in TISSUES.items():
        console.print(f"[bold]{name}[/]")
        console.print(_table(preset))
        console.print(_distension_line(name), soft_wrap=True)
    console.print("A scene names one as duct.tissue; what it says itself of the wall goes before.")


def distensions() -> dict[str, dict[str, object]]:
    """Return for each preset how a closed tube of it is stretched by Duch's pressure, and what was measured."""
    test = DUCH_DISTENSION
    said: dict[str, dict[str, object]] = {}
    for name, preset in TISSUES.items():
        along, around = preset.stretched(test.pressure_pa, test.radius_m)
        measured = None if preset.distension is None else asdict(preset.distension)
        said[name] = {"along": along, "around": around, "measured": measured}
    return said


def _distension_line(name: str) -> str:
    test, preset = DUCH_DISTENSION, TISSUES[name]
    along, around = preset.stretched(test.pressure_pa, test.radius_m)
    tube = f"a closed tube, {2e3 * test.radius_m:g} mm wide, at {1e-3 * test.pressure_pa:g} kPa"
    got = f"{tube}: {100 * along:.1f} % longer and {100 * around:.1f} % wider as a linear wall"
    if (seen := preset.distension) is None:
        return f"{got}; no measurement of it, the porcine common bile duct has {_percent(test)}"
    return f"{got}; measured: {_percent(seen)} ({escape(seen.source)})"


def _percent(seen: Distension) -> str:
    return f"{100 * seen.along:g} and {100 * seen.around:g} %"


def _table(preset: Tissue) -> Table:
    quantities = preset.quantities().items()
    return value_table("quantity", (ValueRow(name, q.value, q.low, q.high, q.source) for name, q in quantities))
