r"""Implicit force of the stiffening wall: an impulse at the start of a step that equals the force at its end.

An explicit kick would be stable only while the stiffening is weaker than the linear wall. So the force f at the end of
the step is solved for: the modes end at x = p + G f, with p their end without f and G the displacement per impulse. f
minimises :math:`\frac12 f G f + E(p + G f)`, which is strictly convex as E is. Newton's method with conjugate
gradients, begun where the last two forces point, reads the samples' strains once an iteration, in single precision.

p assumes the contact forces of the last step. At rest the force is then exactly that of the law. As E is convex, the
force at the end of a step does no more work than E falls by, unless contacts change, as where the wall is let go;
`settle_step` corrects that.

The energy can be faded out and in, which takes `FADE_S` for all of it.
"""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from trocar.services.mechanics.arrays import AnyArray, Float32Array, FloatArray
from trocar.services.mechanics.compiled import kernel, summing_kernel
from trocar.services.mechanics.compiled.struct import Address, Struct, reader
from trocar.services.mechanics.reduction.hyperelastic.energy_sampling import StretchSamples
from trocar.services.mechanics.reduction.hyperelastic.fung_membrane import beyond_linear_at

NEWTON_STEPS = 2
GRADIENT_STEPS = 4
SEARCH_STEPS = 6
RELATIVE = 1e-3
"""Error over the force at which Newton's method ends, in the norm that 1 + H makes, H the second derivative of E. Where
it begins the residual stands for it, which is no smaller."""
SLACK = 0.1
"""Part of a step's error that conjugate gradients, or the search along it, may leave."""
UNBOUNDED = math.inf
FADE_S = 0.25
"""Time in which all of the stiffening fades out or in; the same as that of the softening wall."""
LEAST_GAIN = 1e-6
"""Least gain over the largest one: an exact oscillator whose half period divides the step
would have none."""
ENERGY, TANK = range(2)
"""Places in the books."""


class HyperelasticWall(Struct):
    """k samples, n = 3 k of their strains, r modes."""

    strain: Annotated[Float32Array, "n", "r"]  # halves what is read; force and energy are of the same rounded rows
    energy: Annotated[FloatArray, "k"]
    scaled: Annotated[Float32Array, "n", "r"]  # strain per root of what an impulse moves a mode by
    root: Annotated[FloatArray, "r"]
    pull: Annotated[FloatArray, "r"]  # state: root times force
    before: Annotated[FloatArray, "r"]  # state: the same of the step before
    ahead: Annotated[FloatArray, "r"]
    at: Annotated[FloatArray, "n"]
    slope: Annotated[FloatArray, "k"]  # 2 w' and 4 w'' of each sample's energy there
    curvature: Annotated[FloatArray, "k"]
    along: Annotated[FloatArray, "n"]
    searched: Annotated[FloatArray, "n"]
    residual: Annotated[Float32Array, "r"]
    step: Annotated[Float32Array, "r"]
    search: Annotated[Float32Array, "r"]
    image: Annotated[Float32Array, "r"]
    faded: Annotated[FloatArray, 1]  # state: part of the energy that does not act
    books: Annotated[FloatArray, 2]  # state: the energy, and what steps have lost of it

    @classmethod
    def of(cls, samples: StretchSamples) -> HyperelasticWall:
        """Take the samples on, at rest; `take_gain` comes before the first step."""
        k, r = len(samples.energy_j), samples.strain.shape[1]
        strain, energy = np.ascontiguousarray(samples.strain, np.float32), np.ascontiguousarray(samples.energy_j)
        return cls.zeros(strain=strain, energy=energy, n=3 * k, k=k, r=r)

    def fade(self, part: float, dt_s: float) -> None:
        """Move the faded part of the energy towards ``part``, by as much as a step of ``dt_s`` allows."""
        most = dt_s / FADE_S
        self.faded[0] += min(max(part - self.faded[0], -most), most)

    def take_gain(self, gain: FloatArray) -> None:
        """Prepare for steps in which an impulse f dt moves the modes by ``gain`` (r,) times f."""
        root = np.sqrt(np.maximum(gain, LEAST_GAIN * gain.max()))
        for pull in (self.pull, self.before):
            pull *= np.divide(root, self.root, out=np.zeros_like(root), where=self.root > 0.0)
        self.root[:] = root
        self.scaled[:] = self.strain * root

    def state_arrays(self) -> tuple[AnyArray, ...]:
        """Return the live arrays of the state."""
        return self.pull, self.before, self.faded, self.books


wall_at = reader(HyperelasticWall)


@kernel
def stretch_force(
    address: Address[HyperelasticWall], free_end: FloatArray, contact_force: FloatArray, out: FloatArray
) -> None:
    """Write the modal force (r,) that is to act as an impulse at the start of the step.

    ``free_end`` (r,) is where the modes come without it and without contacts, ``contact_force`` (r,) what contacts are
    expected to do.
    """
    wall = wall_at(address)
    for mode in range(wall.root.shape[0]):
        wall.ahead[mode] = free_end[mode] / wall.root[mode] + wall.root[mode] * contact_force[mode]
    _extrapolate(wall.pull, wall.before)
    _stretch(wall)
    for _ in range(NEWTON_STEPS):
        if _newton_step(wall):
            break
    for mode in range(wall.root.shape[0]):
        out[mode] = wall.pull[mode] / wall.root[mode]


@kernel
def _extrapolate(pull: FloatArray, before: FloatArray) -> None:
    """Go on as the last two steps went, unless they differ by no more than errors do: a wall at rest would rattle."""
    moved, size = 0.0, 0.0
    for mode in range(pull.shape[0]):
        moved += (pull[mode] - before[mode]) ** 2
        size += pull[mode] * pull[mode]
    goes_on = 1.0 if moved > 4.0 * RELATIVE * RELATIVE * size else 0.0
    for mode in range(pull.shape[0]):
        last = pull[mode]
        pull[mode] += goes_on * (last - before[mode])
        before[mode] = last


@kernel
def stretch_energy(address: Address[HyperelasticWall], q: FloatArray) -> float:
    """Return the energy beyond the linear one at modal coordinates (r,), in J."""
    wall = wall_at(address)
    total = 0.0
    for sample in range(wall.energy.shape[0]):
        a, b, c = _strains(wall.strain, sample, q)
        total += _energy(wall, sample) * beyond_linear_at(a * a + b * b + c * c)[0]
    return total


@kernel
def energy_and_loss(
    address: Address[HyperelasticWall], force: FloatArray, q_start: FloatArray, q: FloatArray
) -> tuple[float, float]:
    """Return the energy at ``q`` (r,), and by how much it fell more than ``force`` (r,) has worked from ``q_start``."""
    energy, work = stretch_energy(address, q), 0.0
    for mode in range(q.shape[0]):
        work += force[mode] * (q[mode] - q_start[mode])
    return energy, wall_at(address).books[ENERGY] - energy - work


@kernel
def _stretch(wall: HyperelasticWall) -> None:
    """Write the strains ``at`` where the modes end with the pull."""
    at, end = wall.at, wall.step
    for mode in range(end.shape[0]):
        end[mode] = wall.ahead[mode] + wall.pull[mode]
    for sample in range(wall.energy.shape[0]):
        i = 3 * sample
        at[i], at[i + 1], at[i + 2] = _strains(wall.scaled, sample, end)


@kernel
def _newton_step(wall: HyperelasticWall) -> bool:
    """Take one step towards the least of |h|^2 / 2 + E(ahead + h), h the pull; True when it is there."""
    residual, pull, at = wall.residual, wall.pull, wall.at
    for mode in range(pull.shape[0]):
        residual[mode] = -pull[mode]
    for sample in range(wall.energy.shape[0]):
        i = 3 * sample
        _, first, second = beyond_linear_at(_form(at, sample))
        slope = wall.slope[sample] = 2.0 * _energy(wall, sample) * first
        wall.curvature[sample] = 4.0 * _energy(wall, sample) * second
        _add_pull(wall.scaled, sample, (-slope * at[i], -slope * at[i + 1], -slope * at[i + 2]), residual)
    size, wrong = 0.0, 0.0
    for mode in range(pull.shape[0]):
        size += pull[mode] * pull[mode]
        wrong += residual[mode] * residual[mode]
    if wrong <= RELATIVE * RELATIVE * size:
        return True
    enough = (0.5 * RELATIVE) ** 2 * size
    decrement, last = _solve_tangent(wall, enough)
    length = _line_search(wall, SLACK * decrement)
    for mode in range(pull.shape[0]):
        pull[mode] += length * wall.step[mode]
    for i in range(at.shape[0]):
        at[i] += length * wall.along[i]
    return length == 1.0 and last + SLACK * SLACK * decrement <= enough


@kernel
def _solve_tangent(wall: HyperelasticWall, enough: float) -> tuple[float, float]:
    """Write the step (1 + H) step = residual, by conjugate gradients, and its strains.

    Returns step (1 + H) step, and what the last iteration added to it: an estimate of the square of the error that is
    left (Hestenes and Stiefel 1952). They end where that is at most ``enough``, or `SLACK` of the step.
    """
    residual, step, search, image = wall.residual, wall.step, wall.search, wall.image
    step[:] = 0.0
    wall.along[:] = 0.0
    left = 0.0
    for mode in range(step.shape[0]):
        search[mode] = residual[mode]
        left += residual[mode] * residual[mode]
    decrement = last = 0.0
    for _ in range(GRADIENT_STEPS):
        _apply_tangent(wall)
        curvature = 0.0
        for mode in range(step.shape[0]):
            curvature += search[mode] * image[mode]
        length, before = left / curvature, left
        left = 0.0
        for mode in range(step.shape[0]):
            step[mode] += length * search[mode]
            residual[mode] -= length * image[mode]
            left += residual[mode] * residual[mode]
        for i in range(wall.along.shape[0]):
            wall.along[i] += length * wall.searched[i]
        last = length * before
        decrement += last
        if last <= max(enough, SLACK * SLACK * decrement) or left == 0.0:
            break
        for mode in range(step.shape[0]):
            search[mode] = residual[mode] + left / before * search[mode]
    return decrement, last


@kernel
def _apply_tangent(wall: HyperelasticWall) -> None:
    """Write image = (1 + H) search, and the strains of the search."""
    search, image, at, searched = wall.search, wall.image, wall.at, wall.searched
    for mode in range(image.shape[0]):
        image[mode] = search[mode]
    for sample in range(wall.energy.shape[0]):
        i = 3 * sample
        a, b, c = _strains(wall.scaled, sample, search)
        searched[i], searched[i + 1], searched[i + 2] = a, b, c
        along = wall.slope[sample]
        turned = wall.curvature[sample] * (at[i] * a + at[i + 1] * b + at[i + 2] * c)
        pull = along * a + turned * at[i], along * b + turned * at[i + 1], along * c + turned * at[i + 2]
        _add_pull(wall.scaled, sample, pull, image)


@kernel
def _line_search(wall: HyperelasticWall, enough: float) -> float:
    """Return how far to go along the step, until the slope is at most ``enough``.

    It is Newton's method on a convex function of one number, within brackets.
    """
    along_pull, along_itself = 0.0, 0.0
    for mode in range(wall.pull.shape[0]):
        along_pull += wall.pull[mode] * wall.step[mode]
        along_itself += wall.step[mode] * wall.step[mode]
    low, high, length = 0.0, UNBOUNDED, 1.0
    for _ in range(SEARCH_STEPS):
        slope, curvature = along_pull + length * along_itself, along_itself
        for sample in range(wall.energy.shape[0]):
            form, turned, own = 0.0, 0.0, 0.0
            for i in range(3 * sample, 3 * sample + 3):
                strain = wall.at[i] + length * wall.along[i]
                form += strain * strain
                turned += strain * wall.along[i]
                own += wall.along[i] * wall.along[i]
            _, first, second = beyond_linear_at(form)
            slope += 2.0 * _energy(wall, sample) * first * turned
            curvature += _energy(wall, sample) * (2.0 * first * own + 4.0 * second * turned * turned)
        if abs(slope) <= enough:
            break
        if slope > 0.0:
            high = length
        else:
            low = length
        length -= slope / curvature
        if not low < length < high:
            length = 0.5 * (low + high) if high < UNBOUNDED else 2.0 * low
    return length


@kernel
def _energy(wall: HyperelasticWall, sample: int) -> float:
    """Return what a sample's energy is multiplied by, as much of it as acts."""
    return float((1.0 - wall.faded[0]) * wall.energy[sample])


@kernel
def _form(strain: FloatArray, sample: int) -> float:
    """Return Q of a sample."""
    total = 0.0
    for i in range(3 * sample, 3 * sample + 3):
        total += strain[i] * strain[i]
    return total


@summing_kernel
def _strains(rows: Float32Array, sample: int, q: AnyArray) -> tuple[float, float, float]:
    """Return a sample's three strains at q (r,), summed in the precision of the products."""
    i = 3 * sample
    a = b = c = q.dtype.type(0.0)
    for mode in range(q.shape[0]):
        a += rows[i, mode] * q[mode]
        b += rows[i + 1, mode] * q[mode]
        c += rows[i + 2, mode] * q[mode]
    return a, b, c


@kernel
def _add_pull(rows: Float32Array, sample: int, stress: tuple[float, float, float], out: Float32Array) -> None:
    """Add a sample's strains times its stress to (r,)."""
    i, a, b, c = 3 * sample, np.float32(stress[0]), np.float32(stress[1]), np.float32(stress[2])
    for mode in range(out.shape[0]):
        out[mode] += rows[i, mode] * a + rows[i + 1, mode] * b + rows[i + 2, mode] * c
