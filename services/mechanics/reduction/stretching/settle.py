"""What a step with the stiffening has gained is taken back: the contact forces were not those that were foretold.

Where nothing touches the wall any more, the step is corrected by the force of where it has led, which gains nothing.
A wall that is touched would move away under its contacts, whose forces are found; there the rates pay.
"""

from __future__ import annotations

from typing import Protocol

from services.mechanics.arrays import FloatArray
from services.mechanics.reduction.state import ModalState
from services.mechanics.reduction.stretching.wall import ENERGY, TANK, StretchedWall, energy_and_loss, stretch_force

TANK_SHARE = 0.1
"""Of the energy: more than that of what steps have lost is not kept for those that gain."""
CREDIT_J = 1e-9
"""It may be owed."""
CORRECTIONS = 8
"""Each is a call of `stretch_force`, and nearer to the force of where the step has led."""
LEAK = 0.01
"""Work of contacts on a correction, which nothing else does, over what the step has gained: more is not taken."""


class KickedModes(Protocol):
    """Modes at the end of a step that a kick and contacts began, see `DuctBody`."""

    state: ModalState
    q_start: FloatArray
    contact_impulse: FloatArray

    @property
    def position_gain(self) -> FloatArray:
        """(r,) what the kick moves them by."""

    def change_kick(self, change: FloatArray) -> None:
        """Let the step end as if the kick had been another."""

    def take_out(self, energy_j: float) -> float:
        """Take energy out of the rates, and return how much they held."""


def settle_step(wall: StretchedWall, force: FloatArray, modes: KickedModes) -> None:
    """Enter what the step has done, and see to it that it gains no more than steps before it have lost.

    Where the step is corrected, ``force`` (r,), with which it was kicked, is changed to that with which it was not.
    What rates do not hold is owed.
    """
    energy_j, lost_j = energy_and_loss(wall.address, force, modes.q_start, modes.state.q)
    tank_j = wall.books[TANK]
    if tank_j + lost_j < -CREDIT_J:
        for _ in range(CORRECTIONS):
            if tank_j + lost_j >= -CREDIT_J or not _correct(wall, force, modes, -lost_j):
                break
            energy_j, lost_j = energy_and_loss(wall.address, force, modes.q_start, modes.state.q)
        if tank_j + lost_j < -CREDIT_J:
            lost_j += modes.take_out(-tank_j - lost_j)
    wall.books[ENERGY] = energy_j
    wall.books[TANK] = min(tank_j + lost_j, TANK_SHARE * energy_j)


def _correct(wall: StretchedWall, force: FloatArray, modes: KickedModes, gained_j: float) -> bool:
    """Kick by the force of where the step has led instead; False, and all is as it was, where contacts forbid it."""
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
