"""What a verification table is made of; `verification_duct.py` and `verification_rod.py` fill them."""

from __future__ import annotations

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
        lines = [f"## {self.title}", "", self.about, ""]
        lines += ["| quantity | mesh | value | reference | error | source |", "|---|---|---|---|---|---|"]
        for e in self.entries:
            unit = f" {e.unit}" if e.unit else ""
            lines.append(
                f"| {e.quantity} | {e.mesh} | {e.value:.5g}{unit} | {e.reference:.5g}{unit} "
                f"| {100 * e.relative_error:+.2f} % | {e.source} |"
            )
        return "\n".join([*lines, ""])
