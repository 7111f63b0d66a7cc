"""``trocar cystic-duct``: the anatomy that a scene's ``duct.cystic`` draws, every range with its source."""

from __future__ import annotations

import json
from dataclasses import asdict

from rich.console import Console

from trocar.services.cli.value_table import ValueRow, value_table
from trocar.services.mechanics.scene.cystic_duct import COURSES, RANGES, CysticDuctScene, drawn_cystic_duct


def run_cystic_duct(seed: int | None, as_json: bool) -> None:
    """Print the ranges, and what a seed draws; without a seed the usual values."""
    drawn = drawn_cystic_duct(CysticDuctScene(seed=seed))
    if as_json:
        ranges = {name: asdict(quantity) for name, quantity in RANGES.items()}
        print(json.dumps({"drawn": asdict(drawn), "ranges": ranges, "courses": COURSES}, indent=1))
        return
    rows = (ValueRow(name, getattr(drawn, name), each.low, each.high, each.source) for name, each in RANGES.items())
    console = Console(highlight=False)
    console.print(value_table("quantity", rows, "drawn" if seed is not None else "usual"))
    shares = ", ".join(f"{course} {100 * share:g} %" for course, share in COURSES.items())
    console.print(f"course: {drawn.course} ({shares})")
    console.print("A scene takes it with duct.cystic; what it says itself goes before.")
