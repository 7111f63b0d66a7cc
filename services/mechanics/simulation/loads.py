"""What a step begins with: the bodies' constant loads, before effects add theirs."""

from __future__ import annotations

from services.mechanics.bodies.duct_loads import DuctMotion, motion_at
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address
from services.mechanics.rod.free_step import FreeStep, step_at


@kernel
def begin_duct_loads(address: Address[DuctMotion]) -> None:
    """Write the constant load over that of the last step, and no kick."""
    duct = motion_at(address)
    for mode in range(duct.force.shape[0]):
        duct.force[mode], duct.kick[mode] = duct.constant[mode], 0.0


@kernel
def begin_loads(duct_address: Address[DuctMotion], catheter_address: Address[FreeStep]) -> None:
    """Write the constant loads over those of the last step, and no kick."""
    begin_duct_loads(duct_address)
    catheter = step_at(catheter_address)
    for i in range(catheter.external.shape[0]):
        for axis in range(3):
            catheter.external[i, axis] = catheter.constant[i, axis]
