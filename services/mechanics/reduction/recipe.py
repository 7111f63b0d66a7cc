"""Inputs of a reduced duct: mesh, section, supports, elements, and the kind of residual compliance."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from trocar.services.mechanics import fem
from trocar.services.mechanics.fem import ElementChoice, ShellModel, ShellSection, Support
from trocar.services.mechanics.reduction.build import full_residual_bytes
from trocar.services.mechanics.reduction.content_hash import hash_content, hash_sources
from trocar.services.mechanics.surface.mesh import TriangleMesh

MIB = 2**20
SMALL_BYTES = 96 * MIB
"""A block between all pairs of up to so much (1,671 nodes) is read without turning it."""
FORMAT = 1
"""Raised when what is stored, or how it is computed from a model, changes; the elements' code is hashed itself."""

_HERE = Path(__file__).parent
LOCAL_SOURCES = tuple(_HERE / name for name in ("residual_vectors.py", "local_modes.py", "softening/load_sites.py"))
STRETCH_SOURCES = tuple(
    _HERE / name for name in ("residual_vectors.py", "hyperelastic/stretch_loads.py", "large_rotations/sections.py")
)
"""What further modes follow from beside the model."""


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
    stretch_modes: bool = False
    """Whether there are modes of the stretched wall beyond ``n_modes``: see `hyperelastic.stretch_loads`."""

    def model(self) -> ShellModel:
        """Return the full model: assembled here, factorised at its first use."""
        return ShellModel(self.mesh, self.section, self.supports, self.elements)

    def key(self) -> str:
        """Return the name of the modes: a hash of everything they follow from, the elements' code included."""
        inputs = (self.mesh, self.section, self.supports, self.n_modes, self.elements)
        local = (self.n_local_modes, hash_sources(*LOCAL_SOURCES)) if self.n_local_modes else ()
        stretch = (hash_sources(*STRETCH_SOURCES),) if self.stretch_modes else ()
        return hash_content(*inputs, FORMAT, hash_sources(Path(fem.__file__).parent), *local, *stretch)
