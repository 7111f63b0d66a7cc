"""Tissue of bile ducts: values with their sources and ranges; a value without a measurement is called an assumption.

No modulus, relaxation time or friction of the human cystic duct was found in the literature. The presets therefore give
for every number its source and the range over which a study should vary it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.fem import Orthotropy, ShellSection
from trocar.services.mechanics.reduction.viscoelastic import PronySeries
from trocar.services.messages.sourced_value import SourcedValue, assumed_value

DUCH = "Duch, Andersen, Gregersen, BioMedical Engineering OnLine 3:23 (2004), ten porcine common bile ducts"
CANINE = "Bio-Medical Materials and Engineering 1(2), 1991"


@dataclass(frozen=True, slots=True)
class Distension:
    """How much longer and wider a tube with closed ends gets under a pressure inside.

    Attributes:
        along, around: float. Stretch along the tube and of its circumference.
        radius_m: float. Radius of the tube at rest.
    """

    pressure_pa: float
    radius_m: float
    along: float
    around: float
    source: str


DUCH_DISTENSION = Distension(
    5e3, 4.3e-3, 0.25, 0.08, f"{DUCH}: 8.6 mm wide at rest and 9.3 mm at 5 kPa, a quarter longer, with closed ends"
)


@dataclass(frozen=True, slots=True)
class Tissue:
    """Wall of a duct.

    Attributes:
        axial_modulus_pa, circumferential_modulus_pa: SourcedValue. Young's moduli along the duct and round it; equal in
            an isotropic wall.
        major_poisson_ratio: SourcedValue. Contraction along the softer direction per stretch along the stiffer one.
        relaxing_shares, relaxation_times_s: tuple of SourcedValue. Prony series of the instantaneous modulus.
        stiffening_exponent: SourcedValue. Exponent of Fung's law: at a uniaxial stretch e the wall is exp(a e^2) times
            as stiff as at rest.
        distension: Distension, optional. The measurement that the moduli are read from.
    """

    thickness_m: SourcedValue
    density_kg_m3: SourcedValue
    axial_modulus_pa: SourcedValue
    circumferential_modulus_pa: SourcedValue
    major_poisson_ratio: SourcedValue
    relaxing_shares: tuple[SourcedValue, ...]
    relaxation_times_s: tuple[SourcedValue, ...]
    stiffening_exponent: SourcedValue
    distension: Distension | None = None

    def section(self, axis: FloatArray) -> ShellSection:
        """Return the shell section; ``axis`` (3,) or (m, 3) is the duct's axis, direction 1 of the material.

        The shear modulus of an orthotropic wall follows Huber's estimate
        sqrt(E1 E2) / (2 (1 + sqrt(nu12 nu21))), in the absence of a measurement.
        """
        E1, ratio, nu12 = self.axial_modulus_pa.value, self.modulus_ratio, self.axial_poisson_ratio
        orthotropy = Orthotropy(axis, ratio, self.shear_modulus_ratio) if self.is_orthotropic else None
        return ShellSection(self.thickness_m.value, E1, nu12, self.density_kg_m3.value, orthotropy)

    @property
    def is_orthotropic(self) -> bool:
        """Whether the wall is stiffer one way than the other."""
        return self.modulus_ratio != 1.0

    @property
    def modulus_ratio(self) -> float:
        """Modulus round the duct over that along it."""
        return self.circumferential_modulus_pa.value / self.axial_modulus_pa.value

    @property
    def axial_poisson_ratio(self) -> float:
        """Contraction round the duct per stretch along it, nu12."""
        return self.major_poisson_ratio.value / max(self.modulus_ratio, 1.0)

    @property
    def shear_modulus_ratio(self) -> float:
        """Huber's shear modulus over the modulus along the duct."""
        nu12, ratio = self.axial_poisson_ratio, self.modulus_ratio
        return float(np.sqrt(ratio) / (2.0 * (1.0 + nu12 * np.sqrt(ratio))))

    def stretched(self, pressure_pa: float, radius_m: float) -> tuple[float, float]:
        """Return how much longer and wider a thin tube with closed ends gets, along and round, in the linear wall.

        Its ends pull along it with half of the tension p r round it. Either tension also contracts the other way.
        """
        round_pa = pressure_pa * radius_m / self.thickness_m.value
        along_pa, nu12 = 0.5 * round_pa, self.axial_poisson_ratio
        E1, E2 = self.axial_modulus_pa.value, self.circumferential_modulus_pa.value
        return (along_pa - nu12 * round_pa) / E1, round_pa / E2 - nu12 * along_pa / E1

    def prony_series(self) -> PronySeries:
        """Return the relaxation of the instantaneous modulus."""
        shares, times = self.relaxing_shares, self.relaxation_times_s
        return PronySeries(tuple(q.value for q in shares), tuple(q.value for q in times))

    def quantities(self) -> dict[str, SourcedValue]:
        """Return all quantities by name; those of the relaxation are numbered."""
        named: dict[str, SourcedValue] = {}
        for name in self.__slots__:
            entry = getattr(self, name)
            if isinstance(entry, SourcedValue):
                named[name] = entry
            elif isinstance(entry, tuple):
                named |= {f"{name}[{index}]": quantity for index, quantity in enumerate(entry)}
        return named


_WALL = assumed_value(0.8e-3, 0.5e-3, 1.2e-3, "assumption; walls of about 1 mm are quoted without measurement")
_DENSITY = assumed_value(1060.0, 1040.0, 1060.0, "assumption; usual for soft tissue")
_POISSON = assumed_value(0.45, 0.40, 0.499, "assumption; soft tissue is nearly incompressible")
_SHARES = tuple(
    assumed_value(share, 0.0, 0.3, f"assumption; ducts of dogs hardly creep ({CANINE}), human ones do (Girard 2019)")
    for share in (0.2, 0.15, 0.1)
)
_TIMES = tuple(
    assumed_value(time, 0.3 * time, 3.0 * time, "assumption; one time a decade over what a grasp lasts")
    for time in (0.1, 1.0, 10.0)
)
_EXPONENT = assumed_value(
    20.0,
    1.0,
    100.0,
    f"assumption; ducts are exponential ({DUCH}), their exponents were not at hand; rabbit carotids have 1 over "
    "strains of 1 (Chuong and Fung, J Biomech Eng 105:268, 1983)",
)

TISSUES: dict[str, Tissue] = {
    "reference_duct": Tissue(
        assumed_value(0.5e-3, 0.5e-3, 1.2e-3, "assumption; the wall of the verification cases"),
        _DENSITY,
        assumed_value(100e3, 30e3, 400e3, "assumption; within the secants that Duch's ducts allow"),
        assumed_value(100e3, 30e3, 400e3, "assumption; isotropic, as in the paper"),
        _POISSON,
        _SHARES,
        _TIMES,
        _EXPONENT,
    ),
    "porcine_common_bile_duct": Tissue(
        _WALL,
        _DENSITY,
        assumed_value(
            45.3e3,
            30.2e3,
            72.5e3,
            f"{DUCH}: closed ends pull with p r / 2 = 10.8 N/m, at 25 % stretch and less what the tension round it "
            "contracts that is 36 N/m over an assumed 0.8 mm",
        ),
        assumed_value(
            260e3,
            174e3,
            417e3,
            f"{DUCH}: p r = 21.5 N/m at 8 % stretch, less what the pull along it contracts, is 208 N/m over an assumed "
            "0.8 mm",
        ),
        _POISSON,
        _SHARES,
        _TIMES,
        _EXPONENT,
        DUCH_DISTENSION,
    ),
    "soft_cystic_duct": Tissue(
        _WALL,
        _DENSITY,
        assumed_value(40e3, 20e3, 93e3, f"assumption; softer than the common bile duct, as in dogs ({CANINE})"),
        assumed_value(200e3, 80e3, 580e3, f"assumption; softer than the common bile duct, as in dogs ({CANINE})"),
        _POISSON,
        _SHARES,
        _TIMES,
        _EXPONENT,
    ),
}


def tissue(name: str) -> Tissue:
    """Return a preset. Raises ValueError if there is no such preset; the message lists the existing ones."""
    if name not in TISSUES:
        raise ValueError(f"unknown tissue '{name}'; known: {', '.join(TISSUES)}")
    return TISSUES[name]
