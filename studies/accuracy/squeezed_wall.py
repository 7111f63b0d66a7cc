"""A reduced wall pressed by rigid jaws: what the hand's force is, tick by tick."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.bodies.duct import DuctBody
from trocar.services.mechanics.bodies.wall_terms import WallTerms, terms_of
from trocar.services.mechanics.reduction import Newmark, ReducedDuct
from trocar.services.mechanics.reduction.softened_wall.softened_wall import SoftenedWall
from trocar.services.mechanics.reduction.softening.training import WallSoftening
from trocar.services.mechanics.reduction.viscoelastic import NEVER, PronySeries, ViscousModes
from trocar.services.mechanics.reduction.viscous_loads import ViscousLoads

DT_S = 1e-3
RAMP = 0.6
"""Part of the ticks in which a squeeze moves; then it rests."""


@dataclass
class SqueezedWall:
    """A wall pressed by rigid jaws that are glued to nodes (k,), each along its own line (k, 3).

    Without ``softening`` it is the linear wall; with a ``series`` it relaxes.
    """

    duct: ReducedDuct
    softening: WallSoftening | None
    nodes: IntArray
    lines: FloatArray
    series: PronySeries = NEVER
    body: DuctBody = field(init=False)
    terms: WallTerms = field(init=False)

    def __post_init__(self) -> None:
        basis, n = self.duct.basis, len(self.nodes)
        integrator = Newmark(basis.omega_rad_s, self.duct.damping_ratio)
        self.body = DuctBody(self.duct, integrator, n)
        self._loads = ViscousLoads(self.series, self.duct.mesh.n_vertices, len(self.body.load_nodes))
        if self.series.g:
            self.body.viscous = ViscousModes(basis.omega_rad_s, self.series)
            self.body.viscous_loads = self._loads
        self.terms = terms_of(self.body)
        if self.softening is not None:
            self.terms.softened = SoftenedWall.of(self.duct, self.softening)
        self._corners = np.stack([self.nodes] * 3, axis=1).astype(np.int32)
        self._weights = np.tile([1.0, 0.0, 0.0], (n, 1))
        self._last_n = np.zeros(n)

    def step(self, wanted_m: FloatArray | None = None, force_n: FloatArray | None = None) -> FloatArray:
        """Take a step to displacements (k,) along the lines, or under forces (k,); returns the forces (N) then."""
        body, k = self.body, len(self.nodes)
        body.change_step(DT_S)
        body.modal_force[:] = 0.0
        self.terms.hold_relaxed()
        self.terms.hold(DT_S)
        body.predict(DT_S)
        body.gather(self._corners, self._weights)
        if force_n is None:
            W = np.zeros((3 * k, 3 * k))
            body.compliance(self._corners, self._weights, W)
            W = np.tril(W) + np.tril(W, -1).T
            along = np.einsum("ka,kalb,lb->kl", self.lines, W.reshape(k, 3, k, 3), self.lines)
            without_m = (body.displacement_m + body.motion_m)[:k]
            if len(self._loads.lasting[0]):
                body.add_load_displacement(self._corners, self._weights, self._loads.lasting, without_m)
            moved = np.sum(self.lines * without_m, axis=1)
            force_n = np.linalg.solve(along, wanted_m - moved)
            at_end_n = force_n + self._lead @ (force_n - self._last_n)
        else:
            at_end_n = force_n
        self._last_n = force_n.copy()
        body.correct(self._corners, self._weights, -force_n[:, None] * self.lines)
        self.terms.settle(lambda: 0.0, DT_S)
        self.terms.end_step(DT_S)
        return at_end_n

    @cached_property
    def _lead(self) -> FloatArray:
        """(k, k) Part of a step by which the forces of a step are older than its end.

        The modes are given their force as an impulse at the start of the step, what they leave out answers at its end:
        a wall whose compliance is that of the modes alone would be answered a whole step late.
        """
        basis, k, nodes = self.duct.basis, len(self.nodes), self.nodes.astype(np.int32)
        modes = np.einsum("ka,kar->kr", self.lines, basis.Phi[nodes]) / basis.omega_rad_s
        rest = np.zeros((k, k))
        for j in range(k):
            moved = np.zeros((k, 3))
            self.duct.residual.apply(nodes[j : j + 1], self.lines[j : j + 1], nodes, moved)
            rest[:, j] = np.sum(self.lines * moved, axis=1)
        of_modes = modes @ modes.T
        lead: FloatArray = np.linalg.solve(of_modes + rest, of_modes)
        return lead

    def displacement_m(self) -> FloatArray:
        """Return how far the nodes are along their lines, (k,)."""
        moved = self.body.surface_m()[self.nodes] - self.duct.mesh.vertices_m[self.nodes]
        along: FloatArray = np.sum(self.lines * moved, axis=1)
        return along

    def squeeze(
        self, wanted_m: FloatArray, ticks: int = 250, start_m: FloatArray | None = None
    ) -> tuple[FloatArray, float]:
        """Move evenly to displacements (k,) and rest there; returns the last forces and the work of the way (J)."""
        start_m = np.zeros(len(self.nodes)) if start_m is None else start_m
        work_j, at = 0.0, start_m
        for tick in range(ticks):
            after = start_m + (wanted_m - start_m) * min(1.0, tick / (RAMP * ticks))
            force = self.step(after)
            work_j, at = work_j + float(force @ (after - at)), after
        return force, work_j
