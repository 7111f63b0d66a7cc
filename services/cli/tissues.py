"""``trocar tissues``: walls that a scene can name, every value with its range and source."""

from __future__ import annotations

import json
from dataclasses import asdict

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from trocar.services.mechanics.scene.tissue import TISSUES, Tissue


def run_tissues(as_json: bool) -> None:
    """Print all presets."""
    if as_json:
        said = {name: {key: asdict(q) for key, q in preset.quantities().items()} for name, preset in TISSUES.items()}
        print(json.dumps({"tissues": said}, indent=1))
        return
    console = Console(highlight=False)
    for name, preset in TISSUES.items():
        console.print(f"[bold]{name}[/]")
        console.print(_table(preset))
    console.print("A scene names one as duct.tissue; what it says itself of the wall goes before.")


def _table(preset: Tissue) -> Table:
    table = Table(box=None, pad_edge=False)
    for title in ("quantity", "value", "from", "to", "source"):
        table.add_column(title, overflow="fold", no_wrap=title == "quantity")
    for name, quantity in preset.quantities().items():
        numbers = (f"{number:g}" for number in (quantity.value, quantity.low, quantity.high))
        table.add_row(escape(name), *numbers, escape(quantity.source))
    return table
