"""The sum of all forces of a rod except contacts, in the order that both integrators use."""

from __future__ import annotations

from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.rod.clamp_forces import add_wall_joints
from trocar.services.mechanics.rod.elasticity import (
    Scale,
    add_bending,
    add_bending_tangent,
    add_stretch,
    add_stretch_tangent,
    mean_elongation,
    segment_geometry,
)
from trocar.services.mechanics.rod.introducer_forces import add_introducer
from trocar.services.mechanics.rod.model import RodModel, RodWork
from trocar.services.mechanics.rod.turning import add_turns, add_turns_tangent


@kernel
def add_internal_forces(model: RodModel, work: RodWork, scale: Scale) -> None:
    """Add to ``work.force`` the elastic, damping and support forces at ``work.position``, with ``lead``.

    If scale[0] is not zero, add their tangent to ``work.band`` too, see `elasticity`.
    """
    segment_geometry(model, work)
    if work.is_middle:
        mean_elongation(model, work)
    add_stretch(model, work)
    add_bending(model, work)
    add_turns(work)
    _add_tangent(model, work, scale)
    _add_supports(model, work, scale)


@inlined_kernel
def add_internal_tangent(model: RodModel, work: RodWork, scale: Scale) -> None:
    """Add to ``work.band`` the tangent of the forces that were added last, without computing most of them again.

    The forces of the supports are added a second time, so ``work.force`` is not valid afterwards.
    """
    _add_tangent(model, work, scale)
    _add_supports(model, work, scale)


@kernel
def _add_tangent(model: RodModel, work: RodWork, scale: Scale) -> None:
    if scale[0] > 0.0:
        add_stretch_tangent(model, work, scale)
        add_bending_tangent(model, work, scale)
        add_turns_tangent(work, scale[1])


@kernel
def _add_supports(model: RodModel, work: RodWork, scale: Scale) -> None:
    add_wall_joints(model, work, scale)
    if model.introducer.is_there:
        if work.is_middle:
            _move_by_lead(work, 1.0)
        add_introducer(model, work, scale[1])
        if work.is_middle:
            _move_by_lead(work, -1.0)


@kernel
def _move_by_lead(work: RodWork, share: float) -> None:
    """Move the particles by ``share`` times the step's lead, because springs to fixed points depend on positions."""
    for i in range(work.position.shape[0]):
        for c in range(3):
            work.position[i, c] += share * work.lead[1, i, c]
