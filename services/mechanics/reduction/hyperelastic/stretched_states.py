"""Modes of a wall that is stretched as a whole: as it is linear, and as its law lets it stretch further.

The responses of the linear wall to pressure and pulls are residual vectors of the basis, see `stretch_loads`. Where the
wall stiffens or gives way it moves otherwise: least where it was stretched most, as round a bend. So the law is solved
on all degrees of freedom under an even pressure, a pull of its end and that pull turned to either side, which bends it.
The responses to the forces of what it is beyond the linear wall there are residual vectors too. These states then are
as all of the wall has them.
"""

from __future__ import annotations

import numpy as np
import scipy

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.fem import ShellModel
from trocar.services.mechanics.fem.factorisation import factorise
from trocar.services.mechanics.reduction.basis import ModalBasis
from trocar.services.mechanics.reduction.free_dofs import free_load, nodal_translations
from trocar.services.mechanics.reduction.hyperelastic.stretch_loads import stretch_loads
from trocar.services.mechanics.reduction.hyperelastic.wall_strain import strain_of_freedoms, taken_strain
from trocar.services.mechanics.reduction.membrane_laws.beyond_linear import BeyondLinear
from trocar.services.mechanics.reduction.residual_vectors import add_residual_vectors

SOLVED_Q = (3.0, 30.0)
"""Largest form that the linear wall would have under the loads that are solved, over that where a law bends: strains of
0.1 to 0.2, and of 0.25 to 0.4. With 1 and 8 a curved wall with fibres is 2.6 % off at a hoop strain of 0.3."""
RELATIVE = 1e-6
"""Of the load: what may be left unbalanced."""
PARTINGS = 2
"""Of the way from one of these loads to the next: a curved wall with fibres does not find it at once."""
MOST_STEPS, MOST_HALVINGS = 20, 8
"""Of Newton's method, which takes three to six, and of its step; a wall that takes more is giving way without end."""


def with_stretch_modes(model: ShellModel, basis: ModalBasis, law: BeyondLinear) -> tuple[ModalBasis, int]:
    """Add the modes of the stretched wall; also returned is how many they are."""
    groups = stretch_loads(model)
    loads = np.concatenate([*groups, _loads_of_law(model, law, groups)])
    return add_residual_vectors(model, basis, loads, len(loads))


def _loads_of_law(
    model: ShellModel, law: BeyondLinear, groups: tuple[FloatArray, FloatArray, FloatArray]
) -> FloatArray:
    """Return what the law bears beyond the linear wall (k, n, 3) where that is inflated, and where it is pulled."""
    pressed, pulled, at_rims = groups
    wall, pull = StretchedWall(model, law), (at_rims if len(at_rims) else pulled).sum(axis=0)
    forces = [wall.forces_beyond(load, SOLVED_Q) for load in (pressed.sum(axis=0), pull)]
    return np.concatenate([*forces, *(wall.forces_beyond(load, SOLVED_Q[:1]) for load in _across(pull))])


def _across(pull: FloatArray) -> FloatArray:
    """Return the same forces (n, 3) turned to either side (2, n, 3): they bend the wall."""
    _, _, axes = np.linalg.svd(pull, full_matrices=False)
    turned: FloatArray = np.linalg.norm(pull, axis=1)[:, None] * axes[1:, None]
    return turned


class StretchedWall:
    """A wall of a law on all its degrees of freedom."""

    def __init__(self, model: ShellModel, law: BeyondLinear) -> None:
        self._model, self._law = model, law
        self._strain, self._energy_j = strain_of_freedoms(model, law), taken_strain(model, law)[1]

    def forces_beyond(self, load: FloatArray, forms: tuple[float, ...]) -> FloatArray:
        """Return the nodal forces (k, n, 3) beyond the linear ones at rest under parts of a load (n, 3).

        ``forms`` are those of `SOLVED_Q` that are solved for.
        """
        whole = free_load(self._model, load)
        linear = self._model.factor.solve(whole)
        form = np.sum((self._strain @ linear).reshape(-1, 3) ** 2, axis=1).max() / self._law.unit_form
        at_rest: FloatArray | None = np.zeros_like(whole)
        forces, begun = [np.zeros((0, *load.shape))], 0.0
        for wanted in forms:
            ended = float(np.sqrt(wanted / form))
            at_rest = None if at_rest is None else self._follow(whole, (begun, ended), at_rest, PARTINGS)
            begun = ended
            if at_rest is not None:
                forces.append(nodal_translations(self._model, self._force(at_rest))[None])
        return np.concatenate(forces)

    def _follow(self, load: FloatArray, sizes: tuple[float, float], u: FloatArray, partings: int) -> FloatArray | None:
        """Return where the wall rests as a load grows from one size to another, in halves where it must."""
        at_rest = self.rest(sizes[1] * load, u)
        if at_rest is not None or partings == 0:
            return at_rest
        middle = 0.5 * (sizes[0] + sizes[1])
        half = self._follow(load, (sizes[0], middle), u, partings - 1)
        return None if half is None else self._follow(load, (middle, sizes[1]), half, partings - 1)

    def rest(self, load: FloatArray, u: FloatArray) -> FloatArray | None:
        """Return the free degrees of freedom (f,) at rest under ``load`` (f,), by Newton's method from ``u`` (f,).

        None where it does not get there, as where rubber is inflated beyond what it bears.
        """
        for _ in range(MOST_STEPS):
            left = load - self._model.K_free @ u - self._force(u)
            if np.linalg.norm(left) <= RELATIVE * np.linalg.norm(load):
                return u
            step = factorise(self._tangent(u)).solve(left)
            energy_j, parts = self._energy(u, load), 0.5 ** np.arange(MOST_HALVINGS)
            most_j = energy_j + RELATIVE**2 * abs(energy_j)  # near rest it falls by less than it is rounded
            part = next((part for part in parts if self._energy(u + part * step, load) <= most_j), None)
            if part is None:
                return None
            u = u + part * step
        return None

    def _energy(self, u: FloatArray, load: FloatArray) -> float:
        beyond, _, _ = self._law.respond((self._strain @ u).reshape(-1, 3))
        return float(0.5 * u @ (self._model.K_free @ u) + self._energy_j @ beyond - load @ u)

    def _force(self, u: FloatArray) -> FloatArray:
        """Return the force (f,) of the law beyond the linear wall's."""
        _, stress, _ = self._law.respond((self._strain @ u).reshape(-1, 3))
        force: FloatArray = self._strain.T @ (self._energy_j[:, None] * stress).ravel()
        return force

    def _tangent(self, u: FloatArray) -> scipy.sparse.csc_array:
        _, _, stiff = self._law.respond((self._strain @ u).reshape(-1, 3))
        m = len(stiff)
        blocks = scipy.sparse.bsr_array(
            (self._energy_j[:, None, None] * stiff, np.arange(m), np.arange(m + 1)), shape=(3 * m, 3 * m)
        )
        return scipy.sparse.csc_array(self._model.K_free + self._strain.T @ blocks @ self._strain)
