"""The elements, one row each: scenes, ``trocar fem`` cases, assembly and the contract suite follow these tables."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Literal

from trocar.services.mechanics.fem.elements import andes, cst, dkmt, dkt, tocher
from trocar.services.mechanics.fem.elements.element import Element

MEMBRANE_ELEMENTS: dict[str, Element] = {
    "cst": Element(cst.stiffness),
    "andes": Element(andes.stiffness, has_stiff_drilling=True),
}
BENDING_ELEMENTS: dict[str, Element] = {
    "dkt": Element(dkt.stiffness),
    "dkmt": Element(dkmt.stiffness),
    "reissner": Element(dkmt.stiffness_of_pressed_wall),
    "tocher": Element(tocher.stiffness, is_reference_only=True),
}

if TYPE_CHECKING:
    MembraneName = str
    BendingName = str
    BendingChoice = str
else:  # made of the tables, so that a check of a configuration against its types knows every row
    MembraneName = Literal[tuple(MEMBRANE_ELEMENTS)]
    BendingName = Literal[tuple(BENDING_ELEMENTS)]
    BendingChoice = Literal[("auto", *BENDING_ELEMENTS)]


def choose(table: Mapping[str, Element], name: str, kind: str) -> Element:
    """Look up an element by name. Raises ValueError if there is no such element; the message lists those there are."""
    if name not in table:
        raise ValueError(f"unknown {kind} element '{name}'; known: {', '.join(table)}")
    return table[name]
