"""A guide wire in a catheter's lumen."""

from __future__ import annotations

from dataclasses import dataclass

from trocar.services.mechanics.scene.catheter_section import CatheterSection


@dataclass(frozen=True, slots=True, kw_only=True)
class GuideWireScene:
    """A round wire that lies along the catheter's axis and slides and turns in it.

    It starts with ``out_m`` beyond the catheter's tip, in its rest shape, which needs room before the mouth. It is kept
    between ``least_out_m`` and ``reach_m``. Its ``sections`` are listed from its own tip on; none of them is steered.
    ``product`` names a file of configs/catheters that says what the scene leaves open; once loaded, a scene has none.
    ``friction`` is the Coulomb coefficient between wire and catheter.
    """

    product: str | None = None
    outer_diameter_m: float = 0.7e-3
    youngs_modulus_pa: float = 1.0e9
    poisson_ratio: float = 0.3
    density_kg_m3: float = 6500.0
    sections: tuple[CatheterSection, ...] = ()
    out_m: float = 10e-3
    least_out_m: float = 5e-3
    reach_m: float = 40e-3
    friction: float = 0.05
