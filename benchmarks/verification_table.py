"""What a verification table is made of; `verification_duct.py` and `verification_rod.py` fill them."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass


@dataclass(frozen=True)
class Entry:
    """One number beside the number it is checked against."""

    quantity: str
    mesh: str
    value: float
    reference: float
    source: str
    unit: str = ""

    @property
    def relative_error(self) -> float:
        return self.value / self.reference - 1.0


@dataclass(frozen=True)
class Table:
    """Entries that belong together, and what a reader must know about them."""

    title: str
    about: str
    entries: list[Entry]

    def to_markdown(self) -> str:
        """Return a row for each quantity, with the errors on all meshes; kinds of mesh are parted by semicolons.

        The source and the meshes of most rows are told above the table, any others in their rows.
        Kinds that have the same meshes are told together.
        """
        rows: dict[tuple[object, ...], dict[str, Entry]] = {}
        for e in self.entries:
            rows.setdefault((e.quantity, e.reference, e.source), {})[e.mesh] = e  # a mode that is double has one row
        usual = Counter(next(iter(row.values())).source for row in rows.values()).most_common(1)[0][0]
        told = [self.about, f"Reference: {usual}."]
        (mostly, count), *others = Counter(meshes(list(row)) for row in rows.values()).most_common()
        column = ["mesh"] if others else []
        if count == 1 and others:
            mostly = ""
        told += [f"Mesh: {mostly}."] if mostly else []
        head = ["quantity", *column, "reference", "error, %"]
        lines = [f"## {self.title}", "", " ".join(told), "", _row(head), "|" + "---|" * len(head)]
        for row in rows.values():
            first = next(iter(row.values()))
            source = "" if first.source == usual else f"; {first.source}"
            unit = f" {first.unit}" if first.unit else ""
            errors = "; ".join(
                ", ".join(f"{100 * row[name].relative_error:+.2f}" for name in kind) for kind in _kinds(list(row))
            )
            own = meshes(list(row))
            mesh = ["" if own == mostly else own] if column else []
            lines.append(_row([first.quantity, *mesh, f"{first.reference:.5g}{unit}{source}", errors]))
        return "\n".join([*lines, ""])


def _row(cells: list[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _kinds(names: list[str]) -> list[list[str]]:
    """Return meshes that differ in their numbers only together."""
    kinds: dict[str, list[str]] = {}
    for name in names:
        kinds.setdefault(re.sub(r"\d+", "#", name), []).append(name)
    return list(kinds.values())


def meshes(names: list[str]) -> str:
    """Return meshes as one: ``cst, 8 a side`` and ``cst, 16 a side`` are ``cst, 8, 16 a side``."""
    elements: dict[str, list[str]] = {}
    for kind in map(_of_one_kind, _kinds(names)):
        element, comma, sizes = kind.partition(", ")
        elements.setdefault(comma + sizes, []).append(element)
    return "; ".join(" and ".join(kinds) + sizes for sizes, kinds in elements.items())


def _of_one_kind(names: list[str]) -> str:
    heads, tails = zip(*(name.rpartition(", ")[::2] for name in names), strict=True)
    sizes, ends = zip(*(re.fullmatch(r"([\d x]*\d|)(.*)", tail).groups() for tail in tails), strict=True)  # type: ignore[union-attr]
    if len({*heads}) > 1 or len({*ends}) > 1:
        return ", ".join(names)
    return f"{heads[0]}{', ' if heads[0] else ''}{', '.join(sizes)}{ends[0]}"
