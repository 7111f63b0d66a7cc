"""What a law of the membrane adds to the linear wall: the law less its own linear part."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import building_kernel, kernel
from trocar.services.mechanics.reduction.membrane_laws import MEMBRANE_LAWS, density_of, law_number, parameters_of
from trocar.services.mechanics.reduction.membrane_laws.law import MembraneLaw, Response, Strain


@dataclass(frozen=True, slots=True)
class BeyondLinear:
    """A law with its parameters.

    Attributes:
        number: int. Its place in the table of laws.
        parameters: (p,) float64
        at_rest: (6,) float64. Its tangent without strain, over E.
    """

    number: int
    parameters: FloatArray
    at_rest: FloatArray

    @classmethod
    def of(cls, name: str, **parameters: float) -> BeyondLinear:
        """Take a law by its name; parameters that are not given have their usual values.

        Raises ValueError: there is no such law, or no such parameter of it, or its value is out of range.
        """
        number, values = law_number(name), np.array(parameters_of(name, parameters), np.float64)
        _, _, tangent = density_of(number, (0.0, 0.0, 0.0), values)
        return cls(number, values, np.array(tangent))

    @property
    def row(self) -> MembraneLaw:
        """The law's row in the table."""
        return list(MEMBRANE_LAWS.values())[self.number]

    @property
    def unit_form(self) -> float:
        """Of strains: where the law is no longer nearly linear, see `MembraneLaw`."""
        return self.row.unit_form(self.parameters)

    def respond(self, strain: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return energy (m,), stress (m, 3) and tangent (m, 3, 3) over E at strains (m, 3)."""
        n = len(strain)
        energy, stress, tangent = np.zeros(n), np.zeros((n, 3)), np.zeros((n, 3, 3))
        write_responses(self.number, (self.parameters, self.at_rest), strain, (energy, stress, tangent))
        return energy, stress, tangent


@kernel
def beyond_linear(law: int, numbers: tuple[FloatArray, FloatArray], strain: Strain) -> Response:
    """Return the response of a law less that of its tangent at rest; ``numbers`` are parameters and that tangent."""
    parameters, rest = numbers
    energy, stress, tangent = density_of(law, strain, parameters)
    x, y, z = strain
    along = rest[0] * x + rest[3] * y + rest[4] * z
    around = rest[3] * x + rest[1] * y + rest[5] * z
    shear = rest[4] * x + rest[5] * y + rest[2] * z
    return (
        energy - 0.5 * (along * x + around * y + shear * z),
        (stress[0] - along, stress[1] - around, stress[2] - shear),
        (
            tangent[0] - rest[0],
            tangent[1] - rest[1],
            tangent[2] - rest[2],
            tangent[3] - rest[3],
            tangent[4] - rest[4],
            tangent[5] - rest[5],
        ),
    )


@building_kernel
def write_responses(
    law: int,
    numbers: tuple[FloatArray, FloatArray],
    strains: FloatArray,
    out: tuple[FloatArray, FloatArray, FloatArray],
) -> None:
    """Write energies (m,), stresses (m, 3) and tangents (m, 3, 3) beyond the linear ones at strains (m, 3)."""
    for i in range(strains.shape[0]):
        energy, stress, tangent = beyond_linear(law, numbers, (strains[i, 0], strains[i, 1], strains[i, 2]))
        out[0][i] = energy
        out[1][i, 0], out[1][i, 1], out[1][i, 2] = stress
        out[2][i, 0, 0], out[2][i, 1, 1], out[2][i, 2, 2] = tangent[0], tangent[1], tangent[2]
        out[2][i, 0, 1] = out[2][i, 1, 0] = tangent[3]
        out[2][i, 0, 2] = out[2][i, 2, 0] = tangent[4]
        out[2][i, 1, 2] = out[2][i, 2, 1] = tangent[5]
