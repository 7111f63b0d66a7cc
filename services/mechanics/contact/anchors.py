r"""Anchors of friction: the elastic slip of every contact that sticks, remembered from tick to tick.

Two surfaces that stick are tied at the point where they last slid, their *anchor*, by the stiffness of the surfaces
themselves: :math:`f_t = -e / c`, e being how far they have moved since and c the row's softness. As e, and not its
rate, sets the force, what sticks does not creep, and the force depends on the step as little as e does. Where the cone
bounds the force the anchor follows: :math:`e = -c f_t` (elastoplastic friction; the return mapping of a plastic bar in
Simo and Hughes, "Computational Inelasticity", 1998, ch. 1).

e is what the bodies have really moved: what a solve that was cut short leaves open is taken up by the next one. It is
kept along world axes with the contact's place on the wall, see `warm_start`, so that it goes with a contact to the next
triangle; it is forgotten when the surfaces part.
"""

from __future__ import annotations

from services.mechanics.arrays import BoolArray, FloatArray
from services.mechanics.compiled import kernel
from services.mechanics.contact.laws import ELASTIC_AXES
from services.mechanics.contact.laws.law import ContactProblem


@kernel
def store_anchors(problem: ContactProblem, slides: BoolArray, out: FloatArray) -> None:
    """Write the elastic slip (C, 3) at the end of the step along world axes, from the solved forces and motions.

    ``slides`` (C,) says where the force is on its cone.
    """
    rows = problem.rows
    for row in range(rows.n_contacts):
        out[row] = 0.0
        force = rows.force_n[row]
        if force[0] == 0.0 and force[1] == 0.0 and force[2] == 0.0:
            continue
        for axis in range(3 - ELASTIC_AXES[rows.law[row]], 3):
            slip = -rows.softness_m_n[row, axis] * force[axis]
            if not slides[row]:
                slip += problem.motion[3 * row + axis]
            for k in range(3):
                out[row, k] += slip * rows.frame[row, axis, k]
