"""The paper's contact response: a spring and damper on the depth of penetration, for comparison."""

from __future__ import annotations

import math

from services.mechanics.compiled import kernel
from services.mechanics.contact.rows import ContactRows
from services.mechanics.contact.solver import UNILATERAL

# Below this sliding speed friction grows in proportion to it: an explicit force cannot stick.
SLIP_SPEED_M_S = 1e-3


@kernel
def penalty_forces(rows: ContactRows, stiffness: float, damping: float, dt_s: float) -> None:
    r"""Write :math:`f_n = \max(0, -k g - c \dot g)` and regularised friction into ``rows.force_n``.

    Explicit: gaps are those of the start of the step and rates those without contact. Stable only while
    :math:`k \Delta t^2` and :math:`c \Delta t` stay below about the mass that gives way, and a load F rests at a
    depth F / k. Holds are springs of the same stiffness up to their limit.
    """
    for row in range(rows.used[0]):
        slip = rows.slip_m[row]
        force = rows.force_n[row]
        motion_n, motion_1, motion_2 = 0.0, 0.0, 0.0
        for axis in range(3):
            motion_n += rows.frame[row, 0, axis] * slip[axis]
            motion_1 += rows.frame[row, 1, axis] * slip[axis]
            motion_2 += rows.frame[row, 2, axis] * slip[axis]
        if rows.kind[row] == UNILATERAL:
            gap = rows.gap_m[row]
            force[0] = max(0.0, -stiffness * gap - damping * motion_n / dt_s) if gap < 0.0 else 0.0
            sliding = math.hypot(motion_1, motion_2)
            scale = rows.limit[row] * force[0] / max(sliding, SLIP_SPEED_M_S * dt_s)
            force[1], force[2] = -scale * motion_1, -scale * motion_2
        else:
            size = stiffness * math.sqrt(motion_n**2 + motion_1**2 + motion_2**2)
            scale = -stiffness * (min(1.0, rows.limit[row] / size) if size > 0.0 else 0.0)
            force[0], force[1], force[2] = scale * motion_n, scale * motion_1, scale * motion_2
