"""What a ``trocar fem`` file says: mesh, material, supports, loads, and what to solve for."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from trocar.services.mechanics.fem.elements import BendingName, MembraneName
from trocar.services.mechanics.surface.units import LengthUnit

LARGEST, SMALLEST = 1e30, 1e-30
"""Of any number in a file but zero: the solution multiplies several, and beyond 1e308 a product is infinite."""


def _in_reach(value: float) -> float:
    if abs(value) > LARGEST:
        raise ValueError(f"must not be larger than {LARGEST:g}, is {value:g}")
    if 0.0 < abs(value) < SMALLEST:
        raise ValueError(f"must not be smaller than {SMALLEST:g}, is {value:g}")
    return value


Number = Annotated[float, Field(allow_inf_nan=False), AfterValidator(_in_reach)]
Positive = Annotated[Number, Field(gt=0.0)]
Vector = tuple[Number, Number, Number]
Dof = Literal["ux", "uy", "uz", "rx", "ry", "rz"]


class Part(BaseModel):
    """A mapping in the file: unknown keys are refused, and so are words and truths for numbers."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

    def given(self, *names: str) -> list[str]:
        """Those of ``names`` that the file gives."""
        return [name for name in names if getattr(self, name) is not None]


def exactly_one(part: Part, *names: str) -> None:
    """Refuse a part that gives none or several of its alternatives."""
    given = part.given(*names)
    if len(given) != 1:
        raise ValueError(f"give exactly one of {', '.join(names)}, not {', '.join(given) or 'none'}")


class ParametricMesh(Part):
    """A duct by numbers; see `trocar.services.mechanics.surface.tube.DuctGeometry`."""

    radius_m: Positive
    length_m: Positive
    n_around: int = 24
    n_along: int = 36
    taper: Number = 0.0
    curvature_1_m: Number = 0.0
    cut_angle_rad: Number = 0.0
    slit_length_m: Number = 0.0
    slit_width_m: Number = 0.0


class PlateMesh(Part):
    """See `trocar.studies.published.panel.Plate`."""

    length_m: Positive
    width_m: Positive
    n_along: int
    n_across: int


class AnnulusMesh(Part):
    """See `trocar.studies.published.panel.Annulus`."""

    inner_radius_m: Positive
    outer_radius_m: Positive
    n_around: int
    n_across: int
    angle_rad: Positive = 2.0 * math.pi


class CylinderMesh(Part):
    """See `trocar.studies.published.panel.Cylinder`."""

    radius_m: Positive
    length_m: Positive
    n_around: int
    n_along: int
    angle_rad: Positive = 2.0 * math.pi


class SphereMesh(Part):
    """See `trocar.studies.published.panel.Sphere`."""

    radius_m: Positive
    n_around: int
    n_up: int
    angle_rad: Positive = 2.0 * math.pi
    latitudes_rad: tuple[Number, Number] = (0.0, math.radians(72.0))


class DuctFile(Part):
    """A tube from a surface file, repaired, with named open ends; see `SurfaceSettings` of `meshes.loading`."""

    path: Path
    units: LengthUnit
    clamped: tuple[str, ...] = ("end_0",)
    mouth: str = "end_1"
    edge_m: Positive | None = None
    lumen_diameter_m: Positive | None = None


class SurfaceFile(Part):
    """Any triangle surface as it stands, with no open ends asked for."""

    path: Path
    units: LengthUnit


class Mesh(Part):
    """Where the triangles come from: exactly one of them."""

    parametric: ParametricMesh | None = None
    plate: PlateMesh | None = None
    annulus: AnnulusMesh | None = None
    cylinder: CylinderMesh | None = None
    sphere: SphereMesh | None = None
    duct_file: DuctFile | None = None
    surface_file: SurfaceFile | None = None

    @model_validator(mode="after")
    def _one(self) -> Mesh:
        exactly_one(self, *type(self).model_fields)
        return self


class Orthotropic(Part):
    """See `trocar.services.mechanics.fem.section.Orthotropy`."""

    axis: Vector
    modulus_ratio: Positive
    shear_modulus_ratio: Positive


class Material(Part):
    """Elastic constants and density; with ``orthotropy`` they are those along the axis."""

    youngs_modulus_pa: Positive
    poisson_ratio: Number
    density_kg_m3: Positive
    orthotropy: Orthotropic | None = None


class Region(Part):
    """A ball in which the wall is thicker or stiffer, for triangles whose centre lies inside."""

    centre_m: Vector
    radius_m: Positive
    thickness_factor: Positive = 1.0
    modulus_factor: Positive = 1.0


class Where(Part):
    """Vertices: exactly one way to name them."""

    vertex_set: str | None = None
    vertex: int | None = Field(default=None, ge=0)
    near_m: Vector | None = None
    box_m: tuple[Vector, Vector] | None = None

    @model_validator(mode="after")
    def _one(self) -> Where:
        exactly_one(self, "vertex_set", "vertex", "near_m", "box_m")
        return self


class Held(Part):
    """Vertices whose dofs are held, at zero or at a given displacement."""

    where: Where
    dofs: tuple[Dof, ...] = ("ux", "uy", "uz", "rx", "ry", "rz")
    displacement_m: Vector = (0.0, 0.0, 0.0)


class Load(Part):
    """One part of the load; exactly one kind, ``force_n`` and ``moment_n_m`` with the vertices they are shared by."""

    force_n: Vector | None = None
    moment_n_m: Vector | None = None
    where: Where | None = None
    pressure_pa: Number | None = None
    traction_pa: Vector | None = None
    acceleration_m_s2: Vector | None = None

    @model_validator(mode="after")
    def _one(self) -> Load:
        exactly_one(self, "force_n", "moment_n_m", "pressure_pa", "traction_pa", "acceleration_m_s2")
        if bool(self.given("force_n", "moment_n_m")) != (self.where is not None):
            raise ValueError("'where' goes with force_n and moment_n_m and with nothing else")
        return self


class Elements(Part):
    """Which triangle carries the membrane and which the bending."""

    membrane: MembraneName = "cst"
    bending: BendingName = "dkt"


class FemCase(Part):
    """A whole file."""

    mesh: Mesh
    thickness_m: Positive
    material: Material
    regions: tuple[Region, ...] = ()
    elements: Elements = Elements()
    constraints: Literal["elimination", "penalty"] = "elimination"
    supports: tuple[Held, ...]
    loads: tuple[Load, ...] = ()
    probes: dict[str, Where] = {}
    analysis: Literal["linear", "nonlinear"] = "linear"
    load_steps: int = Field(default=10, ge=1, le=10_000)
    path: Literal["load", "arc_length"] = "load"
    modes: int = Field(default=0, ge=0)
    buckling: int = Field(default=0, ge=0)

    @model_validator(mode="after")
    def _something_to_solve(self) -> FemCase:
        moved = any(any(held.displacement_m) for held in self.supports)
        if not (self.loads or moved or self.modes):
            raise ValueError("nothing to solve: give loads, a displacement_m in supports, or modes")
        if self.buckling and not (self.loads or moved):
            raise ValueError("buckling needs loads or a displacement_m in supports, of which it finds the multiples")
        return self

    @model_validator(mode="after")
    def _analysis_agrees(self) -> FemCase:
        if self.analysis == "linear":
            for key in self.model_fields_set & {"load_steps", "path"}:
                raise ValueError(f"{key} goes with analysis: nonlinear")
            return self
        if self.buckling:
            raise ValueError(
                "buckling is a linear analysis; a nonlinear path shows it, with path: arc_length beyond it"
            )
        if self.constraints != "elimination":
            raise ValueError("analysis: nonlinear goes with constraints: elimination")
        if not (self.loads or any(any(held.displacement_m) for held in self.supports)):
            raise ValueError("analysis: nonlinear needs loads or a displacement_m in supports")
        return self
