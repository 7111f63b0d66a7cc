"""Energy tank of the stiffening wall: a step may gain no more energy than earlier steps have lost.

A step gains energy where its contact forces differ from those of the last step, which its stiffening force was computed
with. Where nothing touches the wall any more, the step is repeated with the force at its end, which gains nothing. A
wall in contact must not move under contact forces that are already solved; there the energy comes out of the rates.
"""

from __future__ import annotations

from typing import Protocol

from services.mechanics.arrays import FloatArray
from services.mechanics.reduction.hyperelastic.hyperelastic_wall import (
    ENERGY,
    TANK,
    HyperelasticWall,
    energy_and_loss,
    stretch_force,
)
from services.mechanics.reduction.modal_state import ModalState

TANK_SHARE = 0.1
"""Largest content of the tank over the stored energy; what steps lose beyond it is dissipated."""
CREDIT_J = 1e-9
"""Debt that the tank may have: the work of 1 mN over 1 um."""
CORRECTIONS = 8
"""Fixed-point iterations towards the force at the end of the step; each is one call of `stretch_force`."""
LEAK = 0.01
"""Largest work of the contact forces on a correction, over the energy gained; a larger one is refused, for that work
is in no other balance."""


class KickedModes(Protocol):
    """Modes at the end of a step that began with a kick and contact impulses; see `DuctBody`."""

    state: ModalState
    q_start: FloatArray
    contact_impulse: FloatArray

    @property
    def position_gain(self) -> FloatArray:
        """(r,) displacement at the end of the step per unit of kick."""

    def change_kick(self, change: FloatArray) -> None:
        """Let the step end as if the kick had been another."""

    def remove_energy(self, energy_j: float) -> float:
        """Take energy out of the rates, and return how much they held."""


def settle_step(wall: HyperelasticWall, force: FloatArray, modes: KickedModes) -> None:
    """Balance the energy of the step; correct it where it gained more than the tank holds.

    A correction replaces ``force`` (r,), the kick of the step, in place. Energy that the rates do not hold stays in the
    tank as a debt.
    """
    energy_j, lost_j = energy_and_loss(wall.address, force, modes.q_start, modes.state.q)
    tank_j = wall.books[TANK]
    if tank_j + lost_j < -CREDIT_J:
        for _ in range(CORRECTIONS):
            if tank_j + lost_j >= -CREDIT_J or not _correct(wall, force, modes, -lost_j):
                break
            energy_j, lost_j = energy_and_loss(wall.address, force, modes.q_start, modes.state.q)
        if tank_j + lost_j < -CREDIT_J:
            lost_j += modes.remove_energy(-tank_j - lost_j)
    wall.books[ENERGY] = energy_j
    wall.books[TANK] = min(tank_j + lost_j, TANK_SHARE * energy_j)


def _correct(wall: HyperelasticWall, force: FloatArray, modes: KickedModes, gained_j: float) -> bool:
    """Repeat the step with the force at its end; return False and change nothing where contacts do work on that."""
    begun, without = wall.pull.copy(), force.copy()
    contacts = modes.contact_impulse
    stretch_force(wall.address, modes.state.q - modes.position_gain * force, 0.0 * force, without)
    change = without - force
    if abs(contacts @ (modes.position_gain * change)) > LEAK * gained_j:
        wall.pull[:] = begun
        return False
    modes.change_kick(change)
    force[:] = without
    return True
