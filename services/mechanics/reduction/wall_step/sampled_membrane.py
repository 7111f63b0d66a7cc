r"""A membrane on sampled triangles: a term of the wall's potential, by any law of the table.

Strains are linear in the modal coordinates, so a sample knows the law's stress and tangent anywhere on the way of a
step from its strains at both ends.

A wall that relaxes by a Prony series has (1 - sum g) W(q) + sum_k g_k W(q - d_k) in place of W(q), with coordinates d_k
that lag behind q; of them only the strains are kept. W has its least at zero and grows from there, so relaxation, which
brings q - d_k nearer to zero, takes energy out.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from trocar.services.mechanics.arrays import AnyArray, Float32Array, FloatArray
from trocar.services.mechanics.compiled import inlined_kernel, kernel, summing_kernel
from trocar.services.mechanics.compiled.struct import Address, Struct, reader
from trocar.services.mechanics.compiled.vectors import Vector
from trocar.services.mechanics.reduction.hyperelastic.energy_sampling import StretchSamples
from trocar.services.mechanics.reduction.membrane_laws import density_of
from trocar.services.mechanics.reduction.membrane_laws.beyond_linear import beyond_linear
from trocar.services.mechanics.reduction.membrane_laws.law import NO_RESPONSE, Response, Strain, Tangent
from trocar.services.mechanics.reduction.membrane_laws.stretch import plus
from trocar.services.mechanics.reduction.viscoelastic import PronySeries


class SampledMembrane(Struct):
    """k samples, n = 3 k of their strains, r modes; t terms of a Prony series."""

    law: int = 0
    parameters: Annotated[FloatArray, "p"]
    at_rest: Annotated[FloatArray, 6]
    strain: Annotated[Float32Array, "n", "r"]  # halves what is read; force and energy are of the same rounded rows
    energy: Annotated[FloatArray, "k"]
    scaled: Annotated[Float32Array, "n", "r"]  # strain per unit of `WallStep`'s coordinates
    g: Annotated[FloatArray, "t"]
    behind: Annotated[FloatArray, "t", "n"]  # state: strains of the lagging coordinates
    faded: Annotated[FloatArray, 1]  # state: part of the energy that does not act
    start: Annotated[FloatArray, "n"]  # state: strains where the step begins
    at: Annotated[FloatArray, "n"]  # where it ends
    tangent: Annotated[FloatArray, "k", 6]  # of each sample's mean stress, by the strain at the end
    along: Annotated[FloatArray, "n"]
    searched: Annotated[FloatArray, "n"]

    @classmethod
    def of(cls, samples: StretchSamples | None, n_modes: int, series: PronySeries) -> SampledMembrane:
        """Take samples on, none for a wall without the term; ``series`` is how the wall relaxes, if it does."""
        g = np.array(series.g, np.float64)
        if samples is None:
            return cls.zeros(n=0, k=0, r=n_modes, t=len(g), p=0, g=g)
        law, k = samples.law, len(samples.energy_j)
        of_law = {"law": law.number, "parameters": law.parameters, "at_rest": law.at_rest}
        strain, energy = np.ascontiguousarray(samples.strain, np.float32), np.ascontiguousarray(samples.energy_j)
        extents = {"n": 3 * k, "k": k, "r": n_modes, "t": len(g), "p": len(law.parameters)}
        return cls.zeros(strain=strain, energy=energy, g=g, **of_law, **extents)

    def take_root(self, root: FloatArray) -> None:
        """Prepare for the coordinates of `WallStep`, of which each moves its mode by ``root`` (r,)."""
        self.scaled[:] = self.strain * root

    def state_arrays(self) -> tuple[AnyArray, ...]:
        """Return the live arrays of the state."""
        return self.behind, self.faded, self.start


membrane_at = reader(SampledMembrane)


@kernel
def membrane_energy(membrane: SampledMembrane, q: FloatArray) -> float:
    """Return the energy beyond the linear one at modal coordinates (r,), in J."""
    total = 0.0
    for sample in range(membrane.energy.shape[0]):
        total += _energy(membrane, sample, _strains(membrane.strain, sample, q))
    return total


@kernel
def begin_membrane(membrane: SampledMembrane, q: FloatArray) -> float:
    """Note the strains of modal coordinates (r,), where a step begins; return the energy there."""
    total = 0.0
    for sample in range(membrane.energy.shape[0]):
        i, strain = 3 * sample, _strains(membrane.strain, sample, q)
        membrane.start[i], membrane.start[i + 1], membrane.start[i + 2] = strain
        total += _energy(membrane, sample, strain)
    return total


@kernel
def membrane_force(address: Address[SampledMembrane], q: FloatArray, out: FloatArray) -> None:
    """Subtract the slope of the energy at modal coordinates (r,) from ``out`` (r,)."""
    membrane = membrane_at(address)
    for sample in range(membrane.energy.shape[0]):
        _, stress, _ = _respond(membrane, sample, _strains(membrane.strain, sample, q), -1.0)
        _add_pull(membrane.strain, sample, stress, out)


@kernel
def membrane_tangent_times(address: Address[SampledMembrane], q: FloatArray, v: FloatArray, out: FloatArray) -> None:
    """Add the second derivative of the energy at ``q`` (r,), times ``v`` (r,), to ``out`` (r,)."""
    membrane = membrane_at(address)
    for sample in range(membrane.energy.shape[0]):
        _, _, tangent = _respond(membrane, sample, _strains(membrane.strain, sample, q), 1.0)
        _add_pull(membrane.strain, sample, _times(tangent, _strains(membrane.strain, sample, v)), out)


@kernel
def relax_membrane(membrane: SampledMembrane, q: FloatArray, decay: FloatArray) -> float:
    """Let the lagging strains follow those at modal coordinates (r,) by ``decay`` (t,), and return the energy lost."""
    lost = 0.0
    for sample in range(membrane.energy.shape[0]):
        strain = _strains(membrane.strain, sample, q)
        lost += _energy(membrane, sample, strain)
        for term in range(membrane.g.shape[0]):
            behind, i = membrane.behind[term], 3 * sample
            for axis in range(3):
                behind[i + axis] = strain[axis] - decay[term] * (strain[axis] - behind[i + axis])
        lost -= _energy(membrane, sample, strain)
    return lost


@kernel
def stretch_membrane(membrane: SampledMembrane, end: AnyArray) -> None:
    """Write the strains where a step ends, in the coordinates (r,) of `WallStep`."""
    for sample in range(membrane.energy.shape[0]):
        i = 3 * sample
        membrane.at[i], membrane.at[i + 1], membrane.at[i + 2] = _strains(membrane.scaled, sample, end)


@kernel
def add_membrane_pull(membrane: SampledMembrane, points: tuple[float, float], out: Float32Array) -> None:
    """Subtract the mean slope over the step from ``out`` (r,), and keep its derivatives; ``points`` are its places."""
    for sample in range(membrane.energy.shape[0]):
        stress, tangent = _mean(membrane, sample, points, 0.0)
        for entry in range(6):
            membrane.tangent[sample, entry] = tangent[entry]
        _add_pull(membrane.scaled, sample, (-stress[0], -stress[1], -stress[2]), out)


@kernel
def add_membrane_tangent(membrane: SampledMembrane, search: Float32Array, out: Float32Array) -> None:
    """Add the derivative of the mean slope by the end, times ``search`` (r,), to ``out`` (r,); keep its strains."""
    searched = membrane.searched
    for sample in range(membrane.energy.shape[0]):
        i, row = 3 * sample, membrane.tangent[sample]
        strain = _strains(membrane.scaled, sample, search)
        searched[i], searched[i + 1], searched[i + 2] = strain
        _add_pull(membrane.scaled, sample, _times((row[0], row[1], row[2], row[3], row[4], row[5]), strain), out)


@kernel
def membrane_slope_along(membrane: SampledMembrane, points: tuple[float, float], length: float) -> tuple[float, float]:
    """Return the mean slope along the search's step at a part of it, and the derivative of that by the part."""
    slope = curvature = 0.0
    for sample in range(membrane.energy.shape[0]):
        i = 3 * sample
        along = membrane.along[i], membrane.along[i + 1], membrane.along[i + 2]
        stress, tangent = _mean(membrane, sample, points, length)
        pull = _times(tangent, along)
        for axis in range(3):
            slope += stress[axis] * along[axis]
            curvature += pull[axis] * along[axis]
    return slope, curvature


@inlined_kernel
def _mean(membrane: SampledMembrane, sample: int, points: tuple[float, float], length: float) -> tuple[Vector, Tangent]:
    """Return a sample's mean stress on the way to ``at`` and a part of ``along`` more, and its derivative there."""
    i, share = 3 * sample, _lasting_share(membrane)
    x, y, z = membrane.start[i], membrane.start[i + 1], membrane.start[i + 2]
    a = membrane.at[i] + length * membrane.along[i] - x
    b = membrane.at[i + 1] + length * membrane.along[i + 1] - y
    c = membrane.at[i + 2] + length * membrane.along[i + 2] - z
    stress, tangent = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for point in points:
        strain = x + point * a, y + point * b, z + point * c
        _, own, stiff = density_of(membrane.law, strain, membrane.parameters)
        stress, tangent = _sum(stress, own, 0.5 * share), _sum_of_six(tangent, stiff, 0.5 * point * share)
        for term in range(membrane.g.shape[0]):
            behind, part = membrane.behind[term], 0.5 * membrane.g[term]
            gap = strain[0] - behind[i], strain[1] - behind[i + 1], strain[2] - behind[i + 2]
            _, own, stiff = density_of(membrane.law, gap, membrane.parameters)
            stress, tangent = _sum(stress, own, part), _sum_of_six(tangent, stiff, part * point)
    rest, acts = _at_rest(membrane), (1.0 - membrane.faded[0]) * membrane.energy[sample]
    linear = _times(rest, _middle(membrane, i, (x + 0.5 * a, y + 0.5 * b, z + 0.5 * c)))
    mean = acts * (stress[0] - linear[0]), acts * (stress[1] - linear[1]), acts * (stress[2] - linear[2])
    return mean, _sum_of_six((0.0, 0.0, 0.0, 0.0, 0.0, 0.0), _sum_of_six(tangent, rest, -0.5), acts)


@inlined_kernel
def _middle(membrane: SampledMembrane, i: int, strain: Strain) -> Strain:
    """Return the middle of the way less what lags of it: where the linear part of all terms is taken."""
    x, y, z = strain
    for term in range(membrane.g.shape[0]):
        x -= membrane.g[term] * membrane.behind[term, i]
        y -= membrane.g[term] * membrane.behind[term, i + 1]
        z -= membrane.g[term] * membrane.behind[term, i + 2]
    return x, y, z


@inlined_kernel
def _lasting_share(membrane: SampledMembrane) -> float:
    share = 1.0
    for term in range(membrane.g.shape[0]):
        share -= membrane.g[term]
    return share


@inlined_kernel
def _at_rest(membrane: SampledMembrane) -> Tangent:
    rest = membrane.at_rest
    return rest[0], rest[1], rest[2], rest[3], rest[4], rest[5]


@inlined_kernel
def _sum(one: Vector, other: Vector, factor: float) -> Vector:
    return one[0] + factor * other[0], one[1] + factor * other[1], one[2] + factor * other[2]


@inlined_kernel
def _sum_of_six(one: Tangent, other: Tangent, factor: float) -> Tangent:
    return (
        one[0] + factor * other[0],
        one[1] + factor * other[1],
        one[2] + factor * other[2],
        one[3] + factor * other[3],
        one[4] + factor * other[4],
        one[5] + factor * other[5],
    )


@kernel
def _energy(membrane: SampledMembrane, sample: int, strain: Strain) -> float:
    """Return a sample's energy, as much as acts; what lags included."""
    i, share = 3 * sample, _lasting_share(membrane)
    total = share * _beyond(membrane, strain)
    for term in range(membrane.g.shape[0]):
        behind = membrane.behind[term]
        gap = strain[0] - behind[i], strain[1] - behind[i + 1], strain[2] - behind[i + 2]
        total += membrane.g[term] * _beyond(membrane, gap)
    return float((1.0 - membrane.faded[0]) * membrane.energy[sample] * total)


@inlined_kernel
def _beyond(membrane: SampledMembrane, strain: Strain) -> float:
    """Return the law's energy at a strain, less that of its tangent at rest."""
    linear = _times(_at_rest(membrane), strain)
    whole = density_of(membrane.law, strain, membrane.parameters)[0]
    return whole - 0.5 * (strain[0] * linear[0] + strain[1] * linear[1] + strain[2] * linear[2])


@kernel
def _respond(membrane: SampledMembrane, sample: int, strain: Strain, factor: float) -> Response:
    """Return ``factor`` times a sample's energy, stress and tangent, as much as acts; what lags included."""
    numbers, acts = (membrane.parameters, membrane.at_rest), factor * (1.0 - membrane.faded[0])
    acts *= membrane.energy[sample]
    total = plus(NO_RESPONSE, beyond_linear(membrane.law, numbers, strain), acts * _lasting_share(membrane))
    for term in range(membrane.g.shape[0]):
        i, behind = 3 * sample, membrane.behind[term]
        gap = strain[0] - behind[i], strain[1] - behind[i + 1], strain[2] - behind[i + 2]
        total = plus(total, beyond_linear(membrane.law, numbers, gap), acts * membrane.g[term])
    return total


@kernel
def _times(matrix: Tangent, v: Vector) -> Vector:
    """Return a symmetric matrix times a vector."""
    return (
        matrix[0] * v[0] + matrix[3] * v[1] + matrix[4] * v[2],
        matrix[3] * v[0] + matrix[1] * v[1] + matrix[5] * v[2],
        matrix[4] * v[0] + matrix[5] * v[1] + matrix[2] * v[2],
    )


@summing_kernel
def _strains(rows: Float32Array, sample: int, q: AnyArray) -> Strain:
    """Return a sample's three strains at q (r,), summed in the precision of the products."""
    i = 3 * sample
    a = b = c = q.dtype.type(0.0)
    for mode in range(q.shape[0]):
        a += rows[i, mode] * q[mode]
        b += rows[i + 1, mode] * q[mode]
        c += rows[i + 2, mode] * q[mode]
    return float(a), float(b), float(c)


@kernel
def _add_pull(rows: Float32Array, sample: int, stress: Vector, out: AnyArray) -> None:
    """Add a sample's strains times its stress to (r,)."""
    i = 3 * sample
    a, b, c = out.dtype.type(stress[0]), out.dtype.type(stress[1]), out.dtype.type(stress[2])
    for mode in range(out.shape[0]):
        out[mode] += rows[i, mode] * a + rows[i + 1, mode] * b + rows[i + 2, mode] * c
