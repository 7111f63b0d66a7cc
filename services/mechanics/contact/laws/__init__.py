"""The table of contact laws: the one place that names them all, and the one in which a kernel asks which law a row has.

A new law is one module in this folder and one row here. Its number is its place in the table.
"""

from __future__ import annotations

import numpy as np

from services.mechanics.compiled.choice import one_of
from services.mechanics.contact.laws import film, grip, hold, seal, squeeze, unilateral
from services.mechanics.contact.laws.law import ContactLaw, Kernel

LAWS: dict[str, ContactLaw] = {
    "unilateral": unilateral.LAW,
    "hold": hold.LAW,
    "film": film.LAW,
    "seal": seal.LAW,
    "squeeze": squeeze.LAW,
    "grip": grip.LAW,
}


def number_of(law: str) -> int:
    """Return the number of a law, as rows have it.

    Raises
    ------
    ValueError
        The law is not in the table.
    """
    if law not in LAWS:
        raise ValueError(f"contact law '{law}' is not in the table; known: {', '.join(LAWS)}")
    return list(LAWS).index(law)


def _by_law(operation: str) -> Kernel:
    """Make a kernel (law, ...) that does this operation as the law with that number does."""
    return one_of([getattr(law, operation) for law in LAWS.values()])


def _flags(name: str) -> np.ndarray:
    return np.array([getattr(law, name) for law in LAWS.values()])


open_row = _by_law("open_row")
relax = _by_law("relax")
add_unknowns = _by_law("add_unknowns")
project = _by_law("project")
room = _by_law("room")
slides = _by_law("slides")
closed_axes = _by_law("closed_axes")
penalty = _by_law("penalty")
HAS_GAP = _flags("has_gap")
FIXES_DISTANCE = _flags("fixes_distance")
ELASTIC_AXES = _flags("elastic_axes")
