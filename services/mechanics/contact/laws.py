r"""The table of contact laws: each is a set of forces that two touching points may exert on each other.

The normal force is within an interval, the force along the surface within a disk; `admissible` does the rest. While a
force is inside, the surfaces' own softness c is all that gives way, :math:`u = -c f`; on the edge of the disk the slip
opposes the force (maximal dissipation), and at an end of the interval surfaces part, or what is held slips.

A new law is one row here. Its number is its place in the table.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True, kw_only=True)
class Law:
    """A contact law. Multiples are of the largest force `force_limit_n` that a row has.

    Attributes:
        softness_m_n: tuple of float. Compliance of the surfaces along the normal and both tangents: none is perfectly
            rigid, and W stays positive where contacts are redundant.
        sinks_m_s_n: float. Speed per newton at which surfaces creep into each other along the normal, beyond any
            softness.
        pulls, pushes: float. Largest normal forces on the first body, as multiples.
        rubs: float. Largest force along the surface, as a multiple.
        has_friction: bool. Whether that is the coefficient of friction times the pressure beside it.
        needs_limit: bool. Whether a row whose limit is zero bears nothing, whatever the multiples.
        limit_n: float. Initial ``force_limit_n`` of a row.
        has_gap: bool. Whether ``gap_m`` is a distance of two surfaces: a negative one is an overlap.
        fixes_distance: bool. Whether the law constrains the distance of two points at the end of the step, not its
            change.
        elastic_axes: int. Along how many of the row's last axes the contact remembers its elastic slip.
        is_damper: bool. Whether its softness belongs to a rate, so that a hand feels no stiffness.
    """

    softness_m_n: tuple[float, float, float]
    sinks_m_s_n: float = 0.0
    pulls: float = 0.0
    pushes: float = math.inf
    rubs: float = 0.0
    has_friction: bool = False
    needs_limit: bool = False
    limit_n: float = math.inf
    has_gap: bool = False
    fixes_distance: bool = False
    elastic_axes: int = 0
    is_damper: bool = False


# Polished surfaces of a few square millimetres give way by 1 um/N.
SURFACE_SOFTNESS_M_N = 1e-6
# Creep per newton: 5 um in 5 ms, the deepest that it gets. Surfaces recover a share of it per time
# (`free_motion.taken_back`): a viscous layer with a spring beside it, the same at any step.
SINKS_M_S_N = 1e-3
# The jaws' pads and the catheter's wall give way, so that held points do not strain each other by rounding.
GRIP_SOFTNESS_M_N = 1e-4
# A lip of rubber: 2 um at 20 mN.
SEAL_SOFTNESS_M_N = 1e-4
# So soft that it bears nothing: 1 N for a million kilometres.
NO_LOAD_M_N = 1e9

LAWS: dict[str, Law] = {
    # Surfaces, with Coulomb friction that is elastoplastic: see `warm_start.store_anchors`.
    "unilateral": Law(
        softness_m_n=(0.0, SURFACE_SOFTNESS_M_N, SURFACE_SOFTNESS_M_N),
        sinks_m_s_n=SINKS_M_S_N, has_friction=True, has_gap=True, elastic_axes=2,
    ),
    # A body between jaws: held across them (the first axis) at any force while they squeeze, by friction along them.
    "grip": Law(
        softness_m_n=(GRIP_SOFTNESS_M_N,) * 3, pulls=math.inf, rubs=1.0, needs_limit=True, fixes_distance=True,
    ),
    # A viscous film (Couette): somebody writes dt / b on its tangents, with b the drag.
    "film": Law(softness_m_n=(NO_LOAD_M_N,) * 3, pulls=math.inf, rubs=math.inf, is_damper=True),
    # A seal holds along the first axis up to its limit, with an elastic length that is in the row's slip already.
    "seal": Law(softness_m_n=(SEAL_SOFTNESS_M_N,) * 3, pulls=1.0, pushes=1.0),
    # Squeezed material pushes jaws apart. Its slip counts from where a spring between them would carry nothing.
    "squeeze": Law(softness_m_n=(SURFACE_SOFTNESS_M_N,) * 3),
}  # fmt: skip


def number_of(law: str) -> int:
    """Return the number of a law, as rows have it. Raises ValueError: the law is not in the table."""
    if law not in LAWS:
        raise ValueError(f"contact law '{law}' is not in the table; known: {', '.join(LAWS)}")
    return list(LAWS).index(law)


SOFTNESS_M_N = np.array([law.softness_m_n for law in LAWS.values()])
SINKS = np.array([law.sinks_m_s_n for law in LAWS.values()])
PULLS = np.array([law.pulls for law in LAWS.values()])
PUSHES = np.array([law.pushes for law in LAWS.values()])
RUBS = np.array([law.rubs for law in LAWS.values()])
LIMIT_N = np.array([law.limit_n for law in LAWS.values()])
HAS_FRICTION = np.array([law.has_friction for law in LAWS.values()])
NEEDS_LIMIT = np.array([law.needs_limit for law in LAWS.values()])
HAS_GAP = np.array([law.has_gap for law in LAWS.values()])
FIXES_DISTANCE = np.array([law.fixes_distance for law in LAWS.values()])
ELASTIC_AXES = np.array([law.elastic_axes for law in LAWS.values()])
IS_DAMPER = np.array([law.is_damper for law in LAWS.values()])
