"""``trocar catheters``: catheters and guide wires that a scene can name, every value with its range and source."""

from __future__ import annotations

import json
import math
from dataclasses import asdict

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from trocar.services.cli.value_table import ValueRow, value_table
from trocar.services.runtime.config.products import Product, load_product, product_names


def run_catheters(as_json: bool) -> None:
    """Print all products."""
    products = {name: load_product(name) for name in product_names()}
    if as_json:
        said = {
            name: {"title": p.title, "kind": p.kind, "values": {k: asdict(v) for k, v in p.named_values().items()}}
            for name, p in products.items()
        }
        print(json.dumps({"products": said}, indent=1))
        return
    console = Console(highlight=False)
    for name, product in products.items():
        stiffness = f"{1e6 * bending_stiffness_n_m2(product):.3g} N mm²"
        console.print(f"[bold]{escape(name)}[/]: {escape(product.title)}; bending stiffness {stiffness}")
        console.print(_table(product))
    console.print(
        "A scene names one as catheter.product or catheter.guide_wire.product; what it says itself goes before."
    )


def bending_stiffness_n_m2(product: Product) -> float:
    """Return Young's modulus times the second moment of area, behind the sections at the tip."""
    value = {key: each.value for key, each in product.values.items()}
    outer, inner = value["outer_diameter_m"], value.get("inner_diameter_m", 0.0)
    return value["youngs_modulus_pa"] * math.pi / 64.0 * (outer**4 - inner**4)


def _table(product: Product) -> Table:
    return value_table(
        "value",
        (
            ValueRow(k, v.value, v.low, v.high, source_of(v.source, v.assumed))
            for k, v in product.named_values().items()
        ),
    )


def source_of(source: str, assumed: bool) -> str:
    """Return a source as people read it: an assumption says so first."""
    return f"assumption; {source}" if assumed else source
