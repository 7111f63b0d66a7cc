"""Arrays of a softening wall: its trained data, the forces that are followed, and the pattern that is made of them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from trocar.services.mechanics.arrays import AnyArray, Float32Array, FloatArray, IntArray, LongArray
from trocar.services.mechanics.compiled.struct import Struct, reader
from trocar.services.mechanics.reduction.reduced_duct import ReducedDuct
from trocar.services.mechanics.reduction.softened_wall.load_pattern import Pattern
from trocar.services.mechanics.reduction.softening.softening_law import N_PARTS, SofteningLaw

if TYPE_CHECKING:
    from trocar.services.mechanics.reduction.softening.training import WallSoftening

N_MIXED = N_PARTS + 1  # a coefficient for each part of the law, and by how much the nodes count
N_SITES, FIRST, N_NODES, NODE = range(4)
"""What is made of a candidate: sites, the one of them that comes next, nodes, and the node that comes next."""


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
    n_local: int = 0  # modes beside supports, the last ones
    at_sites: Annotated[FloatArray, "l", "m"]  # state: forces on the sites, followed
    at_nodes: Annotated[FloatArray, "h"]  # state: likewise inward forces on the nodes
    modal: Annotated[FloatArray, "r"]  # state: the modal force that belongs to them
    mixed: Annotated[FloatArray, "l", N_MIXED]  # state: forces on the nodes times coefficients and counts, followed
    candidate: Pattern  # is being made of the forces below
    pressed: Annotated[FloatArray, "l", "m"]
    pressed_modal: Annotated[FloatArray, "r"]
    pressed_mixed: Annotated[FloatArray, "l", N_MIXED]
    pressed_nodes: Annotated[FloatArray, "h"]
    active: Annotated[IntArray, "m"]
    active_nodes: Annotated[IntArray, "h"]
    made: Annotated[LongArray, 4]
    shares: Annotated[FloatArray, "l"]  # of the laws
    energies: Annotated[FloatArray, "l", 2]  # V and E that they have
    of_nodes: Annotated[FloatArray, 2]  # V of the nodes so far, and what E is larger by
    nearby: Annotated[FloatArray, "z"]
    law: Annotated[FloatArray, "p"]
    quadratic: Annotated[FloatArray, "l", "m"]
    moved: Annotated[FloatArray, "l", "m"]
    shift: Annotated[FloatArray, "m"]

    @classmethod
    def of(cls, duct: ReducedDuct, softening: WallSoftening) -> SoftenedWall:
        """Take a softening on."""
        # What is learned is imported only where a wall has learned it, see `effects.softening`.
        from trocar.services.mechanics.reduction.softened_wall.site_modes import delivery
        from trocar.services.mechanics.reduction.softening.load_sites import Lumen

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
        }
        plain: dict[str, Any] = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
        plain |= {"candidate": empty_pattern(len(stiffness), law), "n_local": duct.n_local_modes}
        extents = {"r": len(stiffness), "p": len(law.rho), "l": len(laws), "m": len(sites.nodes)}
        extents |= {"h": len(remainder.third), "z": remainder.third.shape[1]}
        return cls.zeros(**extents, **plain)

    def new_pattern(self) -> Pattern:
        """Return a pattern like those that are made of forces, of no force."""
        made = self.candidate
        extents = {"r": len(made.direction), "p": len(made.work)}
        return Pattern.zeros(**extents, rho_first=made.rho_first, rho_step=made.rho_step)

    def state_arrays(self) -> tuple[AnyArray, ...]:
        """Return the live arrays of the state."""
        return self.at_sites, self.at_nodes, self.modal, self.mixed


def empty_pattern(n_modes: int, law: SofteningLaw) -> Pattern:
    """Return a pattern of no force, over the points of a law."""
    step = float(law.rho[1] - law.rho[0])
    return Pattern.zeros(r=n_modes, p=len(law.rho), rho_first=float(law.rho[0]), rho_step=step)


softened_wall_at = reader(SoftenedWall)
