"""Coulomb friction in every contact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Address
from trocar.services.mechanics.contact.rows import ContactRows, rows_at
from trocar.services.mechanics.contact.sliding import SLID_M
from trocar.services.mechanics.effects.base import Effect
from trocar.services.mechanics.scene import SceneModel
from trocar.services.mechanics.world import World


@dataclass(frozen=True, slots=True)
class FrictionSettings:
    """Coefficients between catheter and duct, and between tools and anything.

    No coefficient for a cholangiography catheter on mucosa is published: the defaults are assumptions within
    0.01 (hydrogel) to 0.5 (dry polymer).
    """

    mu_static: float = 0.12
    mu_kinetic: float = 0.08
    tool_mu_static: float = 0.3
    tool_mu_kinetic: float = 0.25

    def __post_init__(self) -> None:
        for static, kinetic in ((self.mu_static, self.mu_kinetic), (self.tool_mu_static, self.tool_mu_kinetic)):
            if not 0.0 <= kinetic <= static:
                raise ValueError(f"kinetic friction {kinetic} is not within 0 and static {static}")


class Friction(Effect):
    """Stick below mu_static times the normal force, slide with mu_kinetic times it.

    A contact whose surfaces have slid on each other has the kinetic coefficient, every other one the static, see
    `contact.sliding`. The law is solved together with the normal forces, see `contact.laws`; friction always opposes
    sliding and so never feeds energy in.
    """

    Settings = FrictionSettings

    def __init__(self, settings: FrictionSettings, scene: SceneModel) -> None:
        super().__init__(settings, scene)
        self._mu = np.array(
            [[settings.mu_static, settings.mu_kinetic], [settings.tool_mu_static, settings.tool_mu_kinetic]]
        )

    def set_friction(self, world: World, dt_s: float) -> None:
        """Set the coefficient of every contact."""
        set_coefficients(world.system.rows.address, self._mu)


@kernel
def set_coefficients(rows_address: Address[ContactRows], mu: FloatArray) -> None:
    """Write the coefficients of all rows; ``mu`` (2, 2) is (static, kinetic) without and with a tool.

    A contact whose tangential force is limited to zero keeps no friction, because a hold carries that force.
    """
    rows = rows_at(rows_address)
    for row in range(rows.n_contacts):
        mu_row: float = mu[1 if rows.tool[row] >= 0 else 0, 1 if rows.slid_m[row] >= SLID_M else 0]
        rows.friction[row] = mu_row if rows.force_limit_n[row] > 0.0 else 0.0
