r"""Where jaws roll on the wall: their points of contact follow with a delay, so that facets do not rock.

A contact acts in a step at the point that is nearest where the step starts. Where a round piece presses with a force N
on a facet that tilts by :math:`\theta`, this point moves by :math:`R \theta`, with R the distance of the piece's axis
from the middle surface, and so does the moment, by :math:`N R \theta`. With the compliance C of the wall to a moment
the facet then tilts by :math:`-g \theta` in the next step, :math:`g = N R C`. C is that of the residual, which has no
inertia, so this is no matter of the step's length: beyond g = 1 the tilt would grow from step to step. Each time the
facet cuts :math:`R \theta^2 / 2` into the piece, and taking that overlap back is what feeds it.

So a contact that lasts acts at the mean of the point at which it acted last and of the nearest one. Then a change of
the point by y leads to one of :math:`(1 - g) y / 2` a step later, which decays below g = 3 (relaxation of a fixed-point
iteration). At rest, the point is the nearest one.
"""

from __future__ import annotations

from trocar.services.mechanics.arrays import IntArray
from trocar.services.mechanics.collision.candidates import Candidates, Where, nearest_to, offset
from trocar.services.mechanics.collision.pieces import N_TOOL_PIECES
from trocar.services.mechanics.compiled import inlined_kernel
from trocar.services.mechanics.compiled.vectors import between, dot, put_row, row
from trocar.services.mechanics.contact.working_set import NO_MEMBER, SAME_NORMAL, WorkingSet


@inlined_kernel
def follow_rolling(found: Candidates, working: WorkingSet, start: Where, corner: IntArray) -> None:
    """Move the points of chosen candidates on tools half of the way back to where they last carried a force.

    ``start`` is that of the step, ``corner`` (m, 3) the nodes of the wall's triangles. Round a corner, where the normal
    would be another one, a point stays.
    """
    for place in range(working.n_chosen):
        i = working.chosen[place]
        p, t, member = found.piece[i], found.triangle[i], working.member_of[i]
        if p >= N_TOOL_PIECES or member == NO_MEMBER:
            continue
        w, nearest = row(found.weight, i), row(found.normal, i)
        middle = between(w, row(working.weight, member), 0.5)
        s, normal = nearest_to(start, corner, (p, t), middle)
        if dot(normal, nearest) >= SAME_NORMAL:
            apart = dot(nearest, offset(start, corner, (p, t), found.s[i], w))
            found.gap_m[i] += dot(normal, offset(start, corner, (p, t), s, middle)) - apart
            found.s[i] = s
            put_row(found.weight, i, middle)
            put_row(found.normal, i, normal)
