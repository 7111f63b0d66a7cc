"""Energy tank of the wall's terms: a step may gain no more energy than earlier steps have lost.

A step gains energy where its contact forces differ from those of the last step, which the held force was computed with.
Where nothing touches the wall any more, the step is repeated with the force of the way that it took, which gains
nothing. A wall in contact must not move under contact forces that are already solved. Nor may a wall move into a body
that is near, because the step has been priced. There the energy comes out of the rates.
"""

from __future__ import annotations

from typing import Protocol

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.reduction.modal_state import ModalState
from trocar.services.mechanics.reduction.wall_step.implicit_step import (
    CREDIT_J,
    ENERGY,
    TANK,
    WallStep,
    energy_and_loss,
    held_force,
)

TANK_SHARE = 0.1
"""Largest content of the tank over the size of the stored energy, which may be below that of a linear wall; what steps
lose beyond it is dissipated."""
MOST_OWED = 0.01
"""Largest debt of a step over the stored energy; with a larger one the step is too long."""
CORRECTIONS = 8
"""Fixed-point iterations towards the force of the way that was taken; each is one call of `held_force`."""
LEAK = 0.01
"""Largest work of the contact forces on a correction, over the energy gained; a larger one is refused, for that work
is in no other balance."""


class HeldModes(Protocol):
    """Modes at the end of a step over which a force was held, with contact impulses; see `DuctBody`."""

    state: ModalState
    q_start: FloatArray
    contact_impulse: FloatArray

    @property
    def held_gain(self) -> FloatArray:
        """(r,) displacement at the end of the step per unit of a force that is held over it."""

    def furthest_m(self, change: FloatArray) -> float:
        """Return how far a change (r,) of the coordinates moves a point of the wall."""

    def change_held(self, held: FloatArray, change: FloatArray) -> None:
        """Let the step end as if the force that was ``held`` (r,) had been another; it is changed in place."""

    def remove_energy(self, energy_j: float) -> float:
        """Take energy out of the rates, and return how much they held."""


def settle_step(wall: WallStep, force: FloatArray, modes: HeldModes, free_m: float) -> float:
    """Balance the energy of the step; correct it where it gained more than the tank holds.

    A correction replaces ``force`` (r,), which was held, in place; all of them move the wall by at most ``free_m``.
    Energy that the rates do not hold stays in the tank as a debt. Returned is what the step has lost.
    """
    energy_j, lost_j = energy_and_loss(wall.address, force, modes.q_start, modes.state.q)
    tank_j = wall.books[TANK]
    if tank_j + lost_j < -CREDIT_J:
        for _ in range(CORRECTIONS):
            moved_m = 0.0 if tank_j + lost_j >= -CREDIT_J else _correct(wall, force, modes, (-lost_j, free_m))
            if moved_m == 0.0:
                break
            free_m -= moved_m
            energy_j, lost_j = energy_and_loss(wall.address, force, modes.q_start, modes.state.q)
    paid_j = modes.remove_energy(-tank_j - lost_j) if tank_j + lost_j < -CREDIT_J else 0.0
    wall.books[ENERGY] = energy_j
    wall.books[TANK] = min(tank_j + lost_j + paid_j, TANK_SHARE * abs(energy_j))
    return lost_j


def _correct(wall: WallStep, force: FloatArray, modes: HeldModes, most: tuple[float, float]) -> float:
    """Repeat the step with the force of its way, or go towards it, and return how far that moves the wall in m.

    ``most`` is (energy gained in J, motion in m). Where contacts do work on the motion, nothing is changed, and it is
    0.
    """
    begun, of_way = (wall.pull.copy(), wall.before.copy()), force.copy()
    held_force(wall.address, modes.q_start, modes.state.q - modes.held_gain * force, of_way)
    change = of_way - force
    moved_m = modes.furthest_m(modes.held_gain * change)
    if moved_m > most[1]:
        change *= most[1] / moved_m
        moved_m = most[1]
    if moved_m == 0.0 or abs(modes.contact_impulse @ (modes.held_gain * change)) > LEAK * most[0]:
        wall.pull[:], wall.before[:] = begun
        return 0.0
    modes.change_held(force, change)
    return moved_m
