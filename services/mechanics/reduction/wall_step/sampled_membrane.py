r"""A membrane on sampled triangles: a term of the wall, by any law of the table.

What it reads of the wall are the strains of its samples, which are linear in the modal coordinates.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from trocar.services.mechanics.arrays import AnyArray, FloatArray
from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.compiled.struct import Struct
from trocar.services.mechanics.compiled.vectors import Vector
from trocar.services.mechanics.reduction.hyperelastic.energy_sampling import StretchSamples
from trocar.services.mechanics.reduction.membrane_laws.beyond_linear import beyond_linear


class SampledMembrane(Struct):
    """k samples."""

    law: int = 0
    parameters: Annotated[FloatArray, "p"]
    at_rest: Annotated[FloatArray, 6]
    energy: Annotated[FloatArray, "k"]
    faded: Annotated[FloatArray, 1]  # state: part of the energy that does not act
    tangent: Annotated[FloatArray, "k", 6]  # second derivatives, summed over a way

    @classmethod
    def of(cls, samples: StretchSamples | None) -> SampledMembrane:
        """Take samples on, none for a wall without the term."""
        if samples is None:
            return cls.zeros(k=0, p=0)
        law, energy = samples.law, np.ascontiguousarray(samples.energy_j)
        of_law = {"law": law.number, "parameters": law.parameters, "at_rest": law.at_rest}
        return cls.zeros(k=len(energy), p=len(law.parameters), energy=energy, **of_law)

    def state_arrays(self) -> tuple[AnyArray, ...]:
        """Return the live arrays of the state."""
        return (self.faded,)


@kernel
def add_membrane_slope(
    membrane: SampledMembrane, strain: FloatArray, weights: tuple[float, float], out: FloatArray
) -> float:
    """Add the slope at strains (3 k,) to ``out`` (3 k,), and the second derivatives to the tangents, by ``weights``.

    Return the energy beyond the linear one, in J.
    """
    total = 0.0
    for sample in range(membrane.energy.shape[0]):
        i, acts = 3 * sample, _acting(membrane, sample)
        energy, stress, stiff = _respond(membrane, strain, i)
        total += acts * energy
        for axis in range(3):
            out[i + axis] += weights[0] * acts * stress[axis]
        for entry in range(6):
            membrane.tangent[sample, entry] += weights[1] * acts * stiff[entry]
    return total


@kernel
def add_membrane_tangent(membrane: SampledMembrane, v: FloatArray, out: FloatArray) -> None:
    """Add the tangents times ``v`` (3 k,) to ``out`` (3 k,)."""
    for sample in range(membrane.energy.shape[0]):
        i, matrix = 3 * sample, membrane.tangent[sample]
        a, b, c = v[i], v[i + 1], v[i + 2]
        out[i] += matrix[0] * a + matrix[3] * b + matrix[4] * c
        out[i + 1] += matrix[3] * a + matrix[1] * b + matrix[5] * c
        out[i + 2] += matrix[4] * a + matrix[5] * b + matrix[2] * c


@inlined_kernel
def _acting(membrane: SampledMembrane, sample: int) -> float:
    return float((1.0 - membrane.faded[0]) * membrane.energy[sample])


@kernel
def _respond(
    membrane: SampledMembrane, strain: FloatArray, i: int
) -> tuple[float, Vector, tuple[float, float, float, float, float, float]]:
    """Return energy, stress and tangent of the sample whose strains begin at ``i``, over its modulus and volume."""
    numbers = membrane.parameters, membrane.at_rest
    return beyond_linear(membrane.law, numbers, (strain[i], strain[i + 1], strain[i + 2]))
