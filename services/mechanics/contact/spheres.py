"""Spheres that touch wall and catheter: their positions, motions and compliances.

An effect owns the spheres. It writes the arrays before detection, and reads the forces of their rows after the solve.
"""

from __future__ import annotations

from typing import Annotated

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.compiled.struct import Address, Struct
from trocar.services.mechanics.contact.rows import MAX_STONES, NO_STONE, ContactRows, rows_at

#: Maximum number of spheres.
MAX_SPHERES = MAX_STONES


class Spheres(Struct):
    """Arrays for s spheres, of which the first ``count`` exist; in m and m/N, along world axes."""

    start: Annotated[FloatArray, "s", 3]  # position at the start of the step
    motion: Annotated[FloatArray, "s", 3]  # free motion over the step
    compliance: Annotated[FloatArray, "s"]  # motion over the step per force
    radius: Annotated[FloatArray, "s"]
    count: int = 0

    def add(self, radius_m: FloatArray) -> slice:
        """Add spheres of these radii (n,) and return their slice of the arrays.

        Raises ValueError if there are more than `MAX_SPHERES` then.
        """
        first, end = self.count, self.count + len(radius_m)
        if end > MAX_SPHERES:
            raise ValueError(f"{end} spheres are too many to be told apart, at most {MAX_SPHERES}")
        self.radius[first:end] = radius_m
        self.count = end
        return slice(first, end)


def no_spheres() -> Spheres:
    """Return arrays for `MAX_SPHERES` spheres, of which none exists yet."""
    return Spheres.zeros(s=MAX_SPHERES)


@inlined_kernel
def add_sphere_compliance(rows: ContactRows, spheres: Spheres, W: FloatArray, from_row: int) -> None:
    """Add the compliance of each sphere between all of its rows to the lower blocks of W, along world axes."""
    for a in range(from_row, rows.n_contacts):
        if rows.stone[a] == NO_STONE:
            continue
        for b in range(a + 1):
            if rows.stone[a] == rows.stone[b]:
                for axis in range(3):
                    W[3 * a + axis, 3 * b + axis] += spheres.compliance[rows.stone[a]]


@kernel
def add_sphere_forces(rows_address: Address[ContactRows], forces: FloatArray, out: FloatArray, first: int) -> None:
    """Add the contact forces (k, 3), in N, on the spheres from ``first`` on to ``out`` (s, 3)."""
    rows = rows_at(rows_address)
    for at in range(rows.n_contacts):
        sphere = rows.stone[at] - first
        if rows.stone[at] != NO_STONE and 0 <= sphere < out.shape[0]:
            for axis in range(3):
                out[sphere, axis] += forces[at, axis]
