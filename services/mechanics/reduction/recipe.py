"""Inputs of a reduced duct: mesh, section, supports, elements, and the kind of residual compliance."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from trocar.services.mechanics.fem import ElementChoice, ShellModel, ShellSection, Support
from trocar.services.mechanics.reduction.build import full_residual_bytes
from trocar.services.mechanics.reduction.content_hash import hash_content
from trocar.services.mechanics.surface.mesh import TriangleMesh

if TYPE_CHECKING:
    from trocar.services.mechanics.reduction.membrane_laws.beyond_linear import BeyondLinear

MIB = 2**20  # bytes, by IEC 80000-13
SMALL_BYTES = 96 * MIB
"""A block between all pairs of up to so much (1,671 nodes) is read without turning it."""


@dataclass(frozen=True, slots=True)
class ResidualChoice:
    """How the residual compliance is kept.

    Attributes:
        kind: str. "full" between all pairs of nodes; "cyclic" of one sector of a symmetric mesh, as exact; "patches"
            within a radius; "none"; "auto" takes the full block of up to `SMALL_BYTES`, that of a sector where there is
            symmetry, and else the full block where it fits the budget and patches beyond.
        budget_bytes: int. Memory of the residual: 512 MiB hold the full block of 3,861 nodes.
        patch_radius_m: float, optional. Radius of the patches; by default the largest that fits the budget.
    """

    kind: Literal["auto", "full", "cyclic", "patches", "none"] = "auto"
    budget_bytes: int = 512 * MIB
    patch_radius_m: float | None = None

    def resolved_kind(self, n_nodes: int, n_sectors: int) -> Literal["full", "cyclic", "patches", "none"]:
        """Return the kind, with "auto" resolved by what fits the budget."""
        if self.kind != "auto":
            return self.kind
        whole_bytes = full_residual_bytes(n_nodes)
        if whole_bytes <= min(self.budget_bytes, SMALL_BYTES):
            return "full"
        if n_sectors > 1 and whole_bytes // n_sectors <= self.budget_bytes:
            return "cyclic"
        return "full" if whole_bytes <= self.budget_bytes else "patches"


@dataclass(frozen=True, slots=True)
class DuctRecipe:
    """All that decides a duct's modes and residual: two equal recipes share one entry of the cache."""

    mesh: TriangleMesh
    section: ShellSection
    supports: tuple[Support, ...]
    n_modes: int
    elements: ElementChoice = field(default_factory=ElementChoice)
    residual: ResidualChoice = field(default_factory=ResidualChoice)
    n_local_modes: int = 0
    """At most, beside supports, beyond ``n_modes``: see `local_modes`."""
    stretch_law: BeyondLinear | None = None
    """Law of a membrane whose stretched wall has modes beyond ``n_modes``: see `hyperelastic.stretched_states`."""

    def model(self) -> ShellModel:
        """Return the full model: assembled here, factorised at its first use."""
        return ShellModel(self.mesh, self.section, self.supports, self.elements)

    def key(self) -> str:
        """Return a hash of everything that the modes follow from, beside the code."""
        inputs = (self.mesh, self.section, self.supports, self.n_modes, self.elements)
        return hash_content(*inputs, self.n_local_modes, self.stretch_law)
