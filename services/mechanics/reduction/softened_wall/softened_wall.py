"""Arrays of a softening wall: its trained data and its state."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np

from trocar.services.mechanics.arrays import AnyArray, Float32Array, FloatArray, IntArray, LongArray
from trocar.services.mechanics.compiled.struct import Struct, reader
from trocar.services.mechanics.reduction.modal_state import ModalIntegrator
from trocar.services.mechanics.reduction.newmark import Newmark
from trocar.services.mechanics.reduction.reduced_duct import ReducedDuct
from trocar.services.mechanics.reduction.softened_wall.load_pattern import GAIN, TURN, Pattern
from trocar.services.mechanics.reduction.softened_wall.site_modes import delivery
from trocar.services.mechanics.reduction.softening.load_sites import Lumen
from trocar.services.mechanics.reduction.softening.softening_law import N_PARTS
from trocar.services.mechanics.reduction.softening.training import WallSoftening
from trocar.services.mechanics.reduction.viscoelastic import NEVER, PronySeries

STORED, SPENT, POTENTIAL, TANK = range(4)
"""Books in J: what is stored, and what was dissipated so far; stored are the pattern's potential and the tank."""
N_BOOKS = 4
N_MIXED = N_PARTS + 1
N_SITES, FIRST, SECOND, N_NODES, NODE = range(5)
"""What is made of a candidate: sites, the pair of them that comes next, nodes, and the node that comes next."""
MOST_SOFTENING = 0.9
"""Largest part of the linear stiffness that may be lost along a pattern; the rest brings the wall back."""


class SoftenedWall(Struct):
    """n nodes, m sites, r modes, t terms of a Prony series.

    There are l laws, that of the sites and that of the nodes, which comes second if there is one; see `TwoLaws`. h is n
    then, and zero otherwise.
    """

    near: Annotated[IntArray, "n", "k"]
    weights: Annotated[FloatArray, "n", "k", 3]
    local: Annotated[FloatArray, "m", "m"]
    third: Annotated[Float32Array, "m", "m", "m"]
    blunt: Annotated[FloatArray, "l", "n"]  # what weights are multiplied with
    inward: Annotated[FloatArray, "h", 3]
    sites_nearby: Annotated[IntArray, "h", "a"]
    nodes_nearby: Annotated[IntArray, "h", "b"]
    sharp: Annotated[Float32Array, "h", "z", "z"]
    node_local: Annotated[Float32Array, "h", "h"]
    coefficients: Annotated[FloatArray, "l", "n", N_PARTS]
    counts: Annotated[FloatArray, "l", "n"]  # one, and the share of the second law
    parts: Annotated[FloatArray, "l", N_PARTS, "p"]
    delivery: Annotated[FloatArray, "r", "m"]
    stiffness: Annotated[FloatArray, "r"]
    rest_q: Annotated[FloatArray, "r"]
    n_local: int = 0  # modes beside supports, the last ones
    takes_mean: bool  # the integrator, of the forces at both ends of a step
    most_softening: float  # part of the linear stiffness that may be lost along a pattern
    to_fade: float = 0.0  # part of the softening, which `faded` goes to
    g: Annotated[FloatArray, "t"]  # Prony's terms, none of a wall that does not relax
    tau_s: Annotated[FloatArray, "t"]
    followed: Annotated[FloatArray, "t", "r"]  # state: d, the modes as far as a term has followed them
    lag: Annotated[FloatArray, "t", "r"]  # state: l
    lagged: Annotated[FloatArray, "r"]  # state: what lags pushes with
    at_sites: Annotated[FloatArray, "l", "m"]  # state: forces on the sites, followed
    at_nodes: Annotated[FloatArray, "h"]  # state: likewise inward forces on the nodes
    modal: Annotated[FloatArray, "r"]  # state: the modal force that belongs to them
    force: Annotated[FloatArray, "r"]  # state: what acts on the modes in the next step
    books: Annotated[FloatArray, N_BOOKS]  # state
    faded: Annotated[FloatArray, 1]  # state: part of the softening that does not act
    mixed: Annotated[FloatArray, "l", N_MIXED]  # state: forces on the nodes times coefficients and counts, followed
    pattern: Pattern  # state: acts
    candidate: Pattern  # is being made of the forces below
    pressed: Annotated[FloatArray, "l", "m"]
    pressed_modal: Annotated[FloatArray, "r"]
    pressed_mixed: Annotated[FloatArray, "l", N_MIXED]
    pressed_nodes: Annotated[FloatArray, "h"]
    active: Annotated[IntArray, "m"]
    active_nodes: Annotated[IntArray, "h"]
    made: Annotated[LongArray, 5]
    shares: Annotated[FloatArray, "l"]  # of the laws
    energies: Annotated[FloatArray, "l", 2]  # V and E that they have
    of_nodes: Annotated[FloatArray, 2]  # V of the nodes so far, and what E is larger by
    nearby: Annotated[FloatArray, "z"]
    law: Annotated[FloatArray, "p"]
    quadratic: Annotated[FloatArray, "l", "m"]
    moved: Annotated[FloatArray, "l", "m"]
    shift: Annotated[FloatArray, "m"]
    foretold: Annotated[FloatArray, "r"]

    @classmethod
    def of(
        cls,
        duct: ReducedDuct,
        softening: WallSoftening,
        constant_modal_force: FloatArray,
        integrator: ModalIntegrator,
        series: PronySeries = NEVER,
    ) -> SoftenedWall:
        """Take a softening on for a duct that rests under a constant modal force (r,).

        ``series`` is how the linear wall relaxes, if it does; see `relaxation`.
        """
        sites, remainder = softening.sites, softening.remainder
        laws = (softening.laws.of_sites, softening.laws.of_nodes)[: 1 + (len(remainder.third) > 0)]
        law = laws[0]
        one = np.ones(len(sites.scale))
        stiffness = duct.basis.omega_rad_s**2
        arrays = {
            "near": sites.near,
            "weights": sites.weights,
            "local": sites.local_m_n,
            "third": softening.third,
            "blunt": np.stack([one, 1.0 / sites.scale][: len(laws)]),
            "inward": remainder.inward,
            "sites_nearby": remainder.sites,
            "nodes_nearby": remainder.nodes,
            "sharp": remainder.third,
            "node_local": remainder.local_m_n,
            "coefficients": np.stack([each.coefficients for each in laws]),
            "counts": np.stack([one, softening.laws.share][: len(laws)]),
            "parts": np.stack([each.work for each in laws]),
            "delivery": delivery(duct, sites, Lumen.of(duct.mesh)),
            "stiffness": stiffness,
            "rest_q": constant_modal_force / stiffness,
        }
        plain: dict[str, Any] = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
        plain |= {"g": np.array(series.g, np.float64), "tau_s": np.array(series.tau_s, np.float64)}
        extents = {"r": len(stiffness), "p": len(law.rho)}
        points = {"rho_first": float(law.rho[0]), "rho_step": float(law.rho[1] - law.rho[0])}
        patterns = {name: Pattern.zeros(**extents, **points) for name in ("pattern", "candidate")}
        takes_mean = isinstance(integrator, Newmark)
        plain |= {"takes_mean": takes_mean, "most_softening": MOST_SOFTENING, "n_local": duct.n_local_modes}
        extents |= {"l": len(laws), "m": len(sites.nodes), "t": len(series.g)}
        extents |= {"h": len(remainder.third), "z": remainder.third.shape[1]}
        return cls.zeros(**extents, **patterns, **plain)

    def stiffens(self) -> bool:
        """Whether what acts is a pattern whose potential has a convex part."""
        numbers = self.pattern.numbers
        return bool(numbers[GAIN] != 0.0 and numbers[TURN] < np.inf)

    def state_arrays(self) -> tuple[AnyArray, ...]:
        """Return the live arrays of the state."""
        own = self.at_sites, self.modal, self.force, self.books, self.mixed, self.followed, self.lag, self.lagged
        return *own, self.faded, self.at_nodes, *self.pattern.state_arrays()


softened_wall_at = reader(SoftenedWall)
