"""Data of a scene in SI units: geometry, materials, contact, effects and the quality ladder.

Plain data without validation: the configuration layer checks a scene file and names the key of an error.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from trocar.services.mechanics.fem.elements import BendingChoice, MembraneName
from trocar.services.mechanics.scene.air_bubble import AirBubble
from trocar.services.mechanics.scene.catheter_section import CatheterSection
from trocar.services.mechanics.scene.cystic_duct import CysticDuctScene
from trocar.services.mechanics.scene.duct_branch import DuctBranch
from trocar.services.mechanics.scene.guide_wire import GuideWireScene
from trocar.services.mechanics.scene.incision import IncisionScene
from trocar.services.mechanics.scene.instruments import ForcepsScene, ToolScene
from trocar.services.mechanics.surface.units import LengthUnit

Vector3 = tuple[float, float, float]
FOLLOWS = {"follows": "from what a scene names, or from where it was said"}
"""Metadata of a derived field, which is no key of a scene file."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DuctScene:
    """The cystic duct: a parametric tube along +x, with or without branches, or the name of a surface file.

    The tube is clamped at x = 0 and open at x = ``length_m``; its mid-surface has the radius ``radius_m``. A scene file
    may leave ``n_around`` and ``n_along`` to the rule in `scene.mesh_cells`: ``auto``. With ``branches`` it is the
    trunk of a tree, meshed with edges of about ``mesh_edge_m``; its far end is held unless branches continue from it.
    Both integrators of its modes are of second order and without numerical damping (spectral radius 1); each mode is
    damped by ``damping_ratio``.
    With ``cystic`` it is a cystic duct by its anatomy, and the common duct that it leaves; ``radius_m``, ``length_m``
    and all else of the tube's shape are then not used.
    ``bending`` is a bending triangle, or "auto": `reissner`, with transverse shear, unless the wall is thin
    (`fem.thinness.bending_of_wall`).
    ``mesh_names`` are the names of a surface file's open ends from the widest on, by default ``end_0``, ``end_1`` and
    so on; ``mesh_up`` is what is up in the file's axes: z of the scene, as near as the mouth's direction allows.
    ``traction_n`` is the pull of a hand at the neck of the gallbladder: it has moved the rim of the mouth outwards, and
    holds it there; 0 holds it where it was. By default nobody holds it.
    ``incision`` is a partial cut across it, an opening of the name "incision", whatever the duct was made from.
    ``tissue`` names the preset of `scene.tissue` from which the wall's values were taken, if any.
    """

    radius_m: float = 4e-3
    length_m: float = 40e-3
    n_around: int = 24
    n_along: int = 30
    taper: float = 0.0
    curvature_1_m: float = 0.0
    cut_angle_rad: float = 0.0
    slit_length_m: float = 0.0
    slit_width_m: float = 0.0
    branches: tuple[DuctBranch, ...] = ()
    cystic: CysticDuctScene | None = None
    mesh_file: str | None = None
    mesh_unit: LengthUnit = "mm"
    mesh_clamped: tuple[str, ...] = ("end_0",)
    mesh_mouth: str = "end_1"
    mesh_edge_m: float | None = None
    mesh_lumen_diameter_m: float | None = None
    mesh_names: tuple[str, ...] = ()
    mesh_up: Vector3 | None = None
    traction_n: float | None = None
    incision: IncisionScene | None = None
    tissue: str | None = None
    thickness_m: float = 0.5e-3
    youngs_modulus_pa: float = 100e3
    poisson_ratio: float = 0.45
    density_kg_m3: float = 1060.0
    membrane: MembraneName = "andes"
    bending: BendingChoice = "auto"
    n_modes: int = 100
    damping_ratio: float = 0.1
    integrator: Literal["newmark", "exact"] = "newmark"
    residual: Literal["auto", "full", "cyclic", "patches", "none"] = "auto"

    @property
    def is_tree(self) -> bool:
        """Whether it is a tree of tubes."""
        return bool(self.branches) or self.cystic is not None


@dataclass(frozen=True, slots=True, kw_only=True)
class CatheterScene:
    """The catheter: particle 0 is the proximal end, the last particle is the tip.

    It starts straight, with its tip at ``tip_position_m`` and the rest along ``-direction`` from there; or, with
    ``before_mouth_m``, at that distance before the duct's mouth, or another ``opening``, on the opening's axis.
    ``anchor`` "clamped" holds the proximal end; with "introducer" it slides through one of ``introducer_length_m``, its
    exit ``introducer_to_tip_m`` behind the tip, and cannot leave it: its last two segments and its first 5 mm stay.
    ``guide_wire`` lies in its lumen and reaches beyond the tip.
    ``introducer_friction`` is the Coulomb coefficient of its wall; ``introducer_seal_friction_n`` the friction of the
    seal at its exit, which keeps a released catheter in place.
    ``product`` names a file of configs/catheters that says what the scene leaves open; once loaded, a scene has none.
    ``spectral_radius`` is the numerical damping of the implicit integrator: the factor, 0 to 1, by which vibrations far
    too fast for the step fall in each step. At 1 they persist, at 0 they vanish at once; vibrations that the step
    resolves are hardly damped. "semi_implicit" is the paper's integrator, without numerical damping.
    ``bubbles`` is the air that comes with contrast agent where nobody has flushed its lumen; a cholangiogram shows it.
    """

    product: str | None = None
    n_segments: int = 50
    length_m: float = 0.1
    outer_diameter_m: float = 1.67e-3
    inner_diameter_m: float = 0.9e-3
    youngs_modulus_pa: float = 70e6
    poisson_ratio: float = 0.45
    density_kg_m3: float = 1100.0
    internal_damping_s: float = 2e-4
    viscous_drag_n_s_m2: float = 0.05
    rest_curvature_1_m: tuple[Vector3, ...] = ()
    sections: tuple[CatheterSection, ...] = ()
    guide_wire: GuideWireScene | None = None
    bubbles: tuple[AirBubble, ...] = ()
    tip_position_m: Vector3 = (46e-3, 0.0, 0.0)
    direction: Vector3 = (-1.0, 0.0, 0.0)
    before_mouth_m: float | None = None
    opening: str = "mouth"
    anchor: Literal["free", "clamped", "introducer"] = "introducer"
    introducer_to_tip_m: float = 60e-3
    introducer_length_m: float = 20e-3
    introducer_friction: float = 0.0
    introducer_seal_friction_n: float = 0.0
    integrator: Literal["implicit", "semi_implicit"] = "implicit"
    spectral_radius: float = 0.6

    @property
    def n_wire_segments(self) -> int:
        """Number of segments of guide wire beyond the tip, none longer than the catheter's at full reach."""
        return math.ceil(self.guide_wire.reach_m * self.n_segments / self.length_m) if self.guide_wire else 0

    @property
    def n_rod_segments(self) -> int:
        """Number of segments of the catheter and, beyond its tip, of the guide wire."""
        return self.n_segments + self.n_wire_segments


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactSettings:
    """Method and parameters of the contact solve.

    "implicit" solves them in contact space; "penalty" is the paper's spring on the depth of penetration.
    Friction exists only when the effect ``friction`` is named in the scene.

    Contacts beyond ``capacity`` are not solved. Where two forceps folded a thin wall 160 to 320 were needed, and bodies
    sank up to 1.1 mm into each other for want of them; with room for 320 a snapshot has 39 MB instead of 28.
    """

    model: Literal["implicit", "penalty"] = "implicit"
    tolerance_n: float = 1e-6
    margin_m: float = 0.5e-3
    capacity: int = 256
    recovery: float = 0.2
    penalty_stiffness_n_m: float = 200.0
    penalty_damping_n_s_m: float = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class QualityLevel:
    """One level of the quality ladder; level 0 is the best, and a switch takes effect in the next tick.

    ``iterations`` limits the sweeps of a solve, unless more are needed to keep bodies apart; ``without`` names effects
    that rest meanwhile. A step is at most ``ticks_per_step`` milliseconds long: a caller with a period of one
    millisecond takes one step in as many periods.
    ``cost_us`` of a tick and the errors of forces and of motion are measured by `trocar tune`, None without it.
    """

    name: str = "full"
    iterations: int = 30
    ticks_per_step: int = 1
    without: tuple[str, ...] = ()
    cost_us: float | None = None
    force_error_percent: float | None = None
    motion_error_percent: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneModel:
    """All settings of a simulation.

    ``effects`` maps the name of each present effect to its settings, the dataclass that the effect calls `Settings`.
    Those in ``essential`` are never dropped to save time, neither by `trocar tune` nor on the quality ladder.
    ``hands`` is the task of simulated hands in the scene, ``target`` the branch that a drive is to reach.
    ``forceps`` are the tools, of any kind; there may be fewer than two.
    With ``duct_alone`` there is neither catheter nor tool, and their settings are ignored.
    ``source`` is the scene's file, with which messages about the scene begin.
    """

    duct: DuctScene = field(default_factory=DuctScene)
    catheter: CatheterScene = field(default_factory=CatheterScene)
    forceps: tuple[ToolScene, ...] = (
        ForcepsScene(),
        ForcepsScene(port_position_m=(0.02, 0.06, 0.15)),
    )
    contact: ContactSettings = field(default_factory=ContactSettings)
    effects: Mapping[str, object] = field(default_factory=dict)
    quality: tuple[QualityLevel, ...] = (QualityLevel(),)
    sleeping: bool = True
    hands: Literal["insertion", "pinch", "press", "drive", "none"] = "insertion"
    target: str = ""
    essential: tuple[str, ...] = ()
    duct_alone: bool = field(default=False, metadata=FOLLOWS)
    source: str = field(default="scene", compare=False, repr=False, metadata=FOLLOWS)
