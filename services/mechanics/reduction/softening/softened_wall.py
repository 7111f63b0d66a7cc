"""The wall's softening in a step: which modal force the loads on the wall call for.

Forces on the wall say *what* is pressed, its displacement says *how far*: the softening of forces theta a, theta such
that they would move the wall as far as it is moved. So the force follows the displacement as an elastic one does, and
gives way with it; as a function of the contact forces, which fall when the wall gives way, it would hunt.
"""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from services.mechanics.arrays import Float32Array, FloatArray, IntArray
from services.mechanics.compiled import kernel, summing_kernel
from services.mechanics.compiled.struct import Address, Struct, reader
from services.mechanics.reduction.duct import ReducedDuct
from services.mechanics.reduction.softening.law import N_PARTS
from services.mechanics.reduction.softening.sites import Lumen
from services.mechanics.reduction.softening.training import WallSoftening, delivery

FOLLOW_S = 2e-3
"""Time in which the pattern of forces is followed: noise of contacts that change from tick to tick stays out."""
LEAST_FORCE_N = 1e-7
"""Below it a wall is not pressed."""
LEAST_SHARE = 1e-4
"""Of the largest force on a site: below it a site does not count in the cubic energy."""
MOST = 2.0
"""Theta: the wall's displacement over that which the forces alone would lead to."""
FIT = (0.5, 3.0)
"""How far the modes' share of a displacement may be made smaller and larger to be that of the sites."""


class SoftenedWall(Struct):
    """What is known of a wall, and its state; m sites, r modes."""

    near: Annotated[IntArray, "n", "k"]
    weights: Annotated[FloatArray, "n", "k", 3]
    local: Annotated[FloatArray, "m", "m"]
    third: Annotated[Float32Array, "m", "m", "m"]
    coefficients: Annotated[FloatArray, "m", N_PARTS]
    work: Annotated[FloatArray, N_PARTS, "p"]
    energy: Annotated[FloatArray, N_PARTS, "p"]
    delivery: Annotated[FloatArray, "r", "m"]
    stiffness: Annotated[FloatArray, "r"]
    rest_q: Annotated[FloatArray, "r"]
    at_sites: Annotated[FloatArray, "m"]  # state: forces on the sites, followed
    modal: Annotated[FloatArray, "r"]  # state: the modal force that belongs to them
    force: Annotated[FloatArray, "r"]  # state: what acts on the modes in the next step
    books: Annotated[FloatArray, 2]  # state: potential energy, and work done on the modes so far
    active: Annotated[IntArray, "m"]
    quadratic: Annotated[FloatArray, "m"]
    moved: Annotated[FloatArray, "m"]
    shift: Annotated[FloatArray, "m"]
    target: Annotated[FloatArray, "r"]
    law: Annotated[FloatArray, 2, "p"]
    rho_first: float
    rho_last: float

    @classmethod
    def of(cls, duct: ReducedDuct, softening: WallSoftening, constant_modal_force: FloatArray) -> SoftenedWall:
        """Take a softening on for a duct that rests under a constant modal force (r,)."""
        sites, law = softening.sites, softening.law
        stiffness = duct.basis.omega_rad_s**2
        arrays = {
            "near": sites.near,
            "weights": sites.weights,
            "local": sites.local_m_n,
            "third": softening.third,
            "coefficients": law.coefficients,
            "work": law.work,
            "energy": law.energy,
            "delivery": delivery(duct, sites, Lumen.of(duct.mesh)),
            "stiffness": stiffness,
            "rest_q": constant_modal_force / stiffness,
        }
        plain = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
        extents = {"m": len(sites.nodes), "r": len(stiffness), "p": len(law.rho)}
        return cls.zeros(**extents, rho_first=float(law.rho[0]), rho_last=float(law.rho[-1]), **plain)

    def state_arrays(self) -> tuple[FloatArray, ...]:
        """Return the live arrays of the state."""
        return self.at_sites, self.modal, self.force, self.books


softened_wall_at = reader(SoftenedWall)


@kernel
def follow_loads(
    address: Address[SoftenedWall],
    loads: tuple[IntArray, FloatArray],
    modal_force: FloatArray,
    motion: tuple[FloatArray, FloatArray],
    dt_s: float,
) -> None:
    """Write the modal force of the next step, and enter what that of the last one has done.

    Parameters
    ----------
    address : Address[SoftenedWall]
    loads : (nodes (l,), forces (l, 3))
        Contact forces on the wall in the last step.
    modal_force : (r,) float64
        What they are on the modes.
    motion : (q (r,), q_start (r,))
        Modal coordinates at the end and at the start of the last step.
    dt_s : float
        Length of the last step.
    """
    wall = softened_wall_at(address)
    q, q_start = motion
    for mode in range(q.shape[0]):
        wall.books[1] += wall.force[mode] * (q[mode] - q_start[mode])
    _follow(wall, loads, modal_force, 1.0 - math.exp(-dt_s / FOLLOW_S))
    wall.books[0] = 0.0
    n = _list_active(wall)
    if n == 0:
        for mode in range(q.shape[0]):
            wall.force[mode] = 0.0
        return
    _soften(wall, q, n)


@kernel
def _follow(wall: SoftenedWall, loads: tuple[IntArray, FloatArray], modal_force: FloatArray, part: float) -> None:
    """Go a part of the way to the forces on the sites and on the modes."""
    nodes, forces = loads
    for site in range(wall.at_sites.shape[0]):
        wall.at_sites[site] *= 1.0 - part
    for load in range(nodes.shape[0]):
        node = nodes[load]
        for k in range(wall.near.shape[1]):
            total = 0.0
            for axis in range(3):
                total += wall.weights[node, k, axis] * forces[load, axis]
            wall.at_sites[wall.near[node, k]] += part * total
    acting = part if nodes.shape[0] > 0 else 0.0
    for mode in range(wall.modal.shape[0]):
        wall.modal[mode] += acting * modal_force[mode] - part * wall.modal[mode]


@kernel
def _list_active(wall: SoftenedWall) -> int:
    """List the sites that are pressed and return how many; forget forces too small to matter."""
    largest, count = 0.0, 0
    for site in range(wall.at_sites.shape[0]):
        largest = max(largest, abs(wall.at_sites[site]))
    if largest < LEAST_FORCE_N:
        for site in range(wall.at_sites.shape[0]):
            wall.at_sites[site] = 0.0
        for mode in range(wall.modal.shape[0]):
            wall.modal[mode] = 0.0
        return 0
    for site in range(wall.at_sites.shape[0]):
        if abs(wall.at_sites[site]) >= LEAST_SHARE * largest:
            wall.active[count] = site
            count += 1
    return count


@kernel
def _soften(wall: SoftenedWall, q: FloatArray, n: int) -> None:
    """Write the force and its potential for a wall that is pressed at ``n`` sites."""
    a, m, r = wall.at_sites, wall.at_sites.shape[0], q.shape[0]
    differentiate(wall, n)
    V, E, size = 0.0, 0.0, 0.0
    for site in range(m):
        V += 0.5 * a[site] * wall.moved[site]
        E += a[site] * wall.quadratic[site] / 3.0
        size += abs(a[site])
    _mix_law(wall, size)
    rho = -E / V if V > 0.0 else 0.0
    linear, seen = 0.0, 0.0
    for mode in range(r):
        linear += wall.modal[mode] ** 2 / wall.stiffness[mode]
        seen += wall.modal[mode] * (q[mode] - wall.rest_q[mode])
    theta = _amplitude(wall, (linear, V, rho), seen)
    work, energy = read_law(wall, theta * rho)
    slope_rho = work - 2.0 * energy  # rho times the derivative of Phi
    for site in range(m):
        # theta (Phi - rho Phi') W a - theta^2 Phi' T a a / 2, where Phi' = slope / (theta rho) and E = -rho V
        second = -slope_rho * theta / rho * wall.quadratic[site] if rho != 0.0 else 0.0
        wall.shift[site] = theta * (energy - slope_rho) * wall.moved[site] + second
    _deliver(wall, theta * V * work)
    stored = theta * theta * V * energy
    for mode in range(r):
        wall.force[mode] = wall.stiffness[mode] * wall.target[mode]
        stored += 0.5 * wall.force[mode] * wall.target[mode]
    wall.books[0] = -stored


@summing_kernel
def differentiate(wall: SoftenedWall, n: int) -> None:
    """Write T a a / 2 and W a of the pressed sites: derivatives of the cubic and of the local linear energy."""
    a, m = wall.at_sites, wall.at_sites.shape[0]
    for site in range(m):
        wall.quadratic[site] = 0.0
        wall.moved[site] = 0.0
    for i in range(n):
        first = wall.active[i]
        for site in range(m):
            wall.moved[site] += a[first] * wall.local[first, site]
        for j in range(i + 1):
            second = wall.active[j]
            product = a[first] * a[second] * (0.5 if i == j else 1.0)
            for site in range(m):
                wall.quadratic[site] += product * wall.third[first, second, site]


@kernel
def _mix_law(wall: SoftenedWall, size: float) -> None:
    """Write the law of forces spread as these are: rows Y and Phi over rho."""
    wall.law[:] = 0.0
    for part in range(N_PARTS):
        coefficient = 0.0
        for site in range(wall.at_sites.shape[0]):
            coefficient += abs(wall.at_sites[site]) * wall.coefficients[site, part]
        coefficient /= size
        for point in range(wall.law.shape[1]):
            wall.law[0, point] += coefficient * wall.work[part, point]
            wall.law[1, point] += coefficient * wall.energy[part, point]


@kernel
def read_law(wall: SoftenedWall, rho: float) -> tuple[float, float]:
    """Return Y and Phi; beyond what was seen Y stays, and rho^2 Phi is the integral of rho Y."""
    inside = min(max(rho, wall.rho_first), wall.rho_last)
    last = wall.law.shape[1] - 1
    place = (inside - wall.rho_first) / (wall.rho_last - wall.rho_first) * last
    point = min(int(place), last - 1)
    part = place - point
    work = (1.0 - part) * wall.law[0, point] + part * wall.law[0, point + 1]
    energy = (1.0 - part) * wall.law[1, point] + part * wall.law[1, point + 1]
    if inside != rho:
        within = (inside / rho) ** 2
        energy = energy * within + 0.5 * work * (1.0 - within)
    return work, energy


@kernel
def _amplitude(wall: SoftenedWall, forces: tuple[float, float, float], seen: float) -> float:
    """Return theta: forces theta a move the modes as far as they have moved. By bisection, as the law is no formula."""
    linear, V, rho = forces
    low, high = 0.0, MOST
    for _ in range(20):
        theta = 0.5 * (low + high)
        if theta * (linear + V * read_law(wall, theta * rho)[0]) < seen:
            low = theta
        else:
            high = theta
    return 0.5 * (low + high)


@summing_kernel
def _deliver(wall: SoftenedWall, work: float) -> None:
    """Write the modal coordinates (r,) that move the sites by ``shift``, of a size at which the forces do ``work``."""
    done = 0.0
    for mode in range(wall.target.shape[0]):
        total = 0.0
        for site in range(wall.shift.shape[0]):
            total += wall.delivery[mode, site] * wall.shift[site]
        wall.target[mode] = total
        done += total * wall.modal[mode]
    fit = work / done if done != 0.0 else 0.0
    fit = min(max(fit, FIT[0]), FIT[1]) if fit > 0.0 else 0.0
    for mode in range(wall.target.shape[0]):
        wall.target[mode] *= fit
