"""The table of contact laws: the one place that names them all, and the one in which a kernel asks which law a row has.

A new law is one module in this folder, as `law` asks for it, and one row here. Its number is its place in the table.
"""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np

from services.mechanics.compiled import kernel
from services.mechanics.compiled.choice import one_of
from services.mechanics.contact.laws import film, grip, hold, seal, squeeze, unilateral
from services.mechanics.contact.rows import ContactRows

LAWS: dict[str, ModuleType] = {
    "unilateral": unilateral,
    "hold": hold,
    "film": film,
    "seal": seal,
    "squeeze": squeeze,
    "grip": grip,
}


def number_of(law: str) -> int:
    """Return the number of a law, as rows have it. Raises ValueError: the law is not in the table."""
    if law not in LAWS:
        raise ValueError(f"contact law '{law}' is not in the table; known: {', '.join(LAWS)}")
    return list(LAWS).index(law)


@kernel
def _all_of_it(rows: ContactRows, row: int, change: tuple[float, float, float]) -> float:
    """Any change of the force is admitted whole."""
    return 1.0


def _of_all(what: str, default: Any = None) -> list[Any]:
    """Return a constant or kernel of every law, in the order of their numbers."""
    said = [getattr(law, what, default) for law in LAWS.values()]
    if None in said:
        raise ValueError(f"contact law '{list(LAWS)[said.index(None)]}' has no '{what}'")
    return said


open_row = one_of(_of_all("open_row"))
relax = one_of(_of_all("relax"))
add_unknowns = one_of(_of_all("add_unknowns"))
project = one_of(_of_all("project"))
room = one_of(_of_all("room", _all_of_it))
slides = one_of(_of_all("slides"))
closed_axes = one_of(_of_all("closed_axes"))
penalty = one_of(_of_all("penalty"))
HAS_GAP = np.array(_of_all("HAS_GAP"))
FIXES_DISTANCE = np.array(_of_all("FIXES_DISTANCE", False))
ELASTIC_AXES = np.array(_of_all("ELASTIC_AXES", 0))
