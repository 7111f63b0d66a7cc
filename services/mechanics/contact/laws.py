r"""The table of contact laws. A law is the set of forces that two touching points may exert on each other.

The normal force lies in an interval, the tangential force in a disk; `admissible` has the operations on both. While a
force is inside its set, only the compliance c of the surfaces gives way, :math:`u = -c f`. On the edge of the disk the
slip opposes the force (maximal dissipation). At an end of the interval surfaces separate, or a held point slips.

A new law is one row of the table. Its number is its place there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True, kw_only=True)
class Law:
    """A contact law. Its force limits are multiples of ``force_limit_n`` of a row."""

    softness_m_n: tuple[float, float, float]  # along normal and tangents; keeps W definite where contacts are redundant
    creep_m_s_n: float = 0.0  # speed per newton at which surfaces creep into each other, in addition
    max_tension: float = 0.0  # largest normal forces on the first body, as multiples
    max_compression: float = math.inf
    max_tangential: float = 0.0  # largest tangential force, as a multiple
    has_friction: bool = False  # whether friction, elastoplastic, is added: its coefficient times the normal force
    needs_limit: bool = False  # whether a row whose limit is zero bears no force at all
    has_gap: bool = False  # whether ``gap_m`` is a distance of two surfaces: a negative one is an overlap
    fixes_distance: bool = False  # whether the distance at the end is constrained, not its change over the step
    touches: bool = True  # whether its forces are those of two surfaces on each other
    is_damper: bool = False  # whether the softness relates force to velocity, so that a hand feels no stiffness


# Polished surfaces of a few square millimetres give way by 1 um/N.
SURFACE_SOFTNESS_M_N = 1e-6
# Surfaces creep by 5 um/N at most, in about 5 ms, because a fraction of that per time is recovered
# (`free_motion.sunk_at_end`): a damper parallel to a spring (Kelvin-Voigt), independent of the step.
CREEP_M_S_N = 1e-3
# Compliance of the jaws' pads and the catheter's wall; it keeps rounding from stressing points that are held twice.
GRIP_SOFTNESS_M_N = 1e-4
# A lip of rubber: 2 um at 20 mN.
SEAL_SOFTNESS_M_N = 1e-4
# So compliant that it bears nothing: 1 N for a million kilometres.
NO_LOAD_M_N = 1e9

LAWS: dict[str, Law] = {
    # Surfaces, with Coulomb friction that is elastoplastic: see `warm_start.store_anchors`.
    "unilateral": Law(
        softness_m_n=(0.0, SURFACE_SOFTNESS_M_N, SURFACE_SOFTNESS_M_N),
        creep_m_s_n=CREEP_M_S_N, has_friction=True, has_gap=True,
    ),
    # A body between jaws: held across them (the first axis) at any force while they squeeze, by friction along them.
    "grip": Law(
        softness_m_n=(GRIP_SOFTNESS_M_N,) * 3,
        max_tension=math.inf, max_tangential=1.0, needs_limit=True, fixes_distance=True,
    ),
    # A viscous film (Couette). The effect that adds the row writes its tangential softness dt / b, with b the drag.
    "film": Law(softness_m_n=(NO_LOAD_M_N,) * 3, max_tension=math.inf, max_tangential=math.inf, is_damper=True),
    # A seal holds along the first axis up to its limit. The slip of its row includes its elastic slip.
    "seal": Law(softness_m_n=(SEAL_SOFTNESS_M_N,) * 3, max_tension=1.0, max_compression=1.0),
    # Squeezed material pushes jaws apart. The slip of its row is zero where a spring between them would be unloaded.
    "squeeze": Law(softness_m_n=(SURFACE_SOFTNESS_M_N,) * 3),
    # The spring of a clip draws with all of its force, however far it has come; the slip of its row begins far away.
    "pull": Law(softness_m_n=(SURFACE_SOFTNESS_M_N,) * 3, max_tension=1.0, max_compression=0.0, touches=False),
}  # fmt: skip


def number_of(law: str) -> int:
    """Return the number of a law, as rows have it. Raises ValueError: the law is not in the table."""
    if law not in LAWS:
        raise ValueError(f"contact law '{law}' is not in the table; known: {', '.join(LAWS)}")
    return list(LAWS).index(law)


SOFTNESS_M_N = np.array([law.softness_m_n for law in LAWS.values()])
CREEP = np.array([law.creep_m_s_n for law in LAWS.values()])
MAX_TENSION = np.array([law.max_tension for law in LAWS.values()])
MAX_COMPRESSION = np.array([law.max_compression for law in LAWS.values()])
MAX_TANGENTIAL = np.array([law.max_tangential for law in LAWS.values()])
HAS_FRICTION = np.array([law.has_friction for law in LAWS.values()])
NEEDS_LIMIT = np.array([law.needs_limit for law in LAWS.values()])
HAS_GAP = np.array([law.has_gap for law in LAWS.values()])
FIXES_DISTANCE = np.array([law.fixes_distance for law in LAWS.values()])
IS_DAMPER = np.array([law.is_damper for law in LAWS.values()])
TOUCHES = np.array([law.touches for law in LAWS.values()])
