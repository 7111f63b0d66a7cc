"""Base of all effects: settings, and the stages of building and stepping a simulation."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.fem import ShellSection
from trocar.services.mechanics.reduction import ReducedDuct
from trocar.services.mechanics.reduction.build import Progress
from trocar.services.mechanics.reduction.recipe import DuctRecipe
from trocar.services.mechanics.rod import RodProperties
from trocar.services.mechanics.scene import SceneModel
from trocar.services.mechanics.scene.wall_bar import WallBar
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.services.mechanics.world import RestartablePart, World


@dataclass(frozen=True, slots=True)
class NoSettings:
    """An effect without settings."""


def require_positive(settings: object, *names: str) -> None:
    """Raise a ValueError that names the first of these settings that is not above zero."""
    for name in names:
        if not getattr(settings, name) > 0.0:
            raise ValueError(f"{name} must be positive, is {getattr(settings, name)}")


def require_not_negative(settings: object, *names: str) -> None:
    """Raise a ValueError that names the first of these settings that is below zero."""
    for name in names:
        if not getattr(settings, name) >= 0.0:
            raise ValueError(f"{name} must not be negative, is {getattr(settings, name)}")


def recipe_of(duct: ReducedDuct, name: str) -> DuctRecipe:
    """Return the recipe that a duct was reduced from; raise a ValueError that names the effect if it is unknown."""
    if duct.recipe is None:
        raise ValueError(f"effects.{name}: the duct has no recipe, use build_scene_duct")
    return duct.recipe


class Effect:
    """One physical effect; override only the stages it acts in.

    An effect that a scene does not name is never constructed. The stages that it does not override are never
    called: there is one list per stage of the effects that act in it.

    Every stage before the bodies exist receives the object that is being built and returns its replacement. Every
    stage of a step gets the world and the length of the step.
    """

    Settings: ClassVar[type[Any]] = NoSettings
    """Frozen dataclass. Its types and `__post_init__` are what a scene file is checked against."""
    of_wall: ClassVar[bool] = False
    """Whether it needs no body but the duct, so that it can act in a scene of only a duct."""
    n_local_modes: ClassVar[int] = 0
    """Largest number of modes beside supports that it needs, see `reduction.local_modes`."""
    can_rest: ClassVar[bool] = False
    """Whether a quality level may leave it out for a while without a jump: it keeps no state from step to step, or it
    fades (`rest`, `wake`)."""

    acts_for_all: ClassVar[bool] = False
    """Whether in the stages of a step the first of those effects that say so acts for all of them."""

    def __init__(self, settings: Any, scene: SceneModel) -> None:
        self.settings = settings
        self.scene = scene
        self._dissipated_j = 0.0

    @property
    def dissipated_j(self) -> float:
        """Energy dissipated by the effect itself so far, beyond that of contact rows."""
        return self._dissipated_j

    @property
    def given_j(self) -> float:
        """Work on the effect so far by somebody who is no hand of the scene; zero by default."""
        return 0.0

    def state_arrays(self) -> tuple[FloatArray, ...]:
        """Return the live arrays of the effect's state; they are only changed in place."""
        return ()

    @property
    def restartable(self) -> RestartablePart | None:
        """State that is not in `step_arrays`, which is saved where a step begins; none by default."""
        return None

    def step_arrays(self) -> tuple[FloatArray, ...]:
        """Return the live arrays that are saved whole where a step begins: all of the state by default."""
        return self.state_arrays()

    def potential_energy_j(self, world: World) -> float:
        """Return the energy stored by the effect and its bodies, for the energy balance; zero by default."""
        return 0.0

    def most_motion_m(self, particles_m: FloatArray) -> float:
        """Return how far particles at (n, 3) may move in a step without a contact that the effect would miss."""
        return math.inf

    def take_back(self, world: World, share: float) -> None:
        """Follow bodies that have been taken back to a share of their motion in this step, before `after_solve`."""

    def rest(self) -> None:
        """Begin to rest at a quality level without the effect; its stages are called until it `rests`."""

    def wake(self) -> None:
        """Act again after resting; the effect's state is then out of date."""

    @property
    def rests(self) -> bool:
        """Whether the effect, told to rest, has no influence any more, so that its stages need not be called."""
        return True

    def check_mesh(self, mesh: TriangleMesh) -> None:
        """Raise a ValueError for a mesh that the effect cannot act on; called before the modes are computed."""

    def place_m(self, mesh: TriangleMesh) -> FloatArray | None:
        """Return where on the duct at rest it acts, for who judges an attempt: (7,) middle and reach in m, and a unit
        vector along the duct.

        None, the default, for an effect that acts at no place in particular.
        """
        return None

    def bars(self, mesh: TriangleMesh) -> tuple[WallBar, ...]:
        """Return the bars on the wall that a picture shows of it, none by default."""
        return ()

    def sphere_radii_m(self) -> tuple[float, ...]:
        """Return the radii of the spheres that it brings into the scene, none by default."""
        return ()

    def sphere_places_m(self) -> FloatArray:
        """Return where these spheres are now (n, 3)."""
        return np.zeros((0, 3))

    def modify_section(self, section: ShellSection) -> ShellSection:
        """Return the wall's thickness and material, before the duct is meshed into elements."""
        raise NotImplementedError

    def constant_load_n(self, mesh: TriangleMesh) -> FloatArray:
        """Return a constant load (n, 3) on the nodes of the duct's mesh, part of its rest shape."""
        raise NotImplementedError

    def modify_duct(self, duct: ReducedDuct) -> ReducedDuct:
        """Return the reduced duct that every process holds."""
        raise NotImplementedError

    def train(self, duct: ReducedDuct, progress: Progress) -> None:
        """Train the effect's model on the reduced duct, store it in the duct's cache, and report to ``progress``."""
        raise NotImplementedError

    def modify_rod(self, rod: RodProperties) -> RodProperties:
        """Return the catheter's properties, before its integrator is built."""
        raise NotImplementedError

    def body_acceleration_m_s2(self) -> FloatArray:
        """Return the acceleration (3,) of a body force on everything that has mass, in scene axes."""
        raise NotImplementedError

    def place_bodies(self, world: World) -> None:
        """Place the bodies that the effect brings, before the wall's first shape is sought, which is clear of them."""
        raise NotImplementedError

    def prepare(self, world: World) -> None:
        """Prepare the effect, once, when the bodies exist."""
        raise NotImplementedError

    def add_loads(self, world: World, dt_s: float) -> None:
        """Add to the bodies' external loads, which are zero at the start of every step."""
        raise NotImplementedError

    def add_rows(self, world: World, dt_s: float) -> None:
        """Append contact rows of the effect's own bodies or laws to ``world.system.rows``."""
        raise NotImplementedError

    def add_motion(self, world: World, dt_s: float) -> None:
        """Add to the free motion of the contact points, once their rows are complete."""
        raise NotImplementedError

    def set_friction(self, world: World, dt_s: float) -> None:
        """Set the contacts' coefficients of friction and the largest forces of holds."""
        raise NotImplementedError

    @property
    def is_settled(self) -> bool:
        """Whether the step that was settled last may stand; if not, it is repeated in halves."""
        return True

    def settle(self, world: World, dt_s: float) -> None:
        """Correct the end of the step when contact forces are known, before other effects act on it."""
        raise NotImplementedError

    def after_solve(self, world: World, dt_s: float) -> None:
        """Act on the bodies at the end of the step, when contact forces are known."""
        raise NotImplementedError


STAGES = (
    "modify_section",
    "constant_load_n",
    "modify_duct",
    "train",
    "modify_rod",
    "body_acceleration_m_s2",
    "place_bodies",
    "prepare",
    "add_loads",
    "add_rows",
    "add_motion",
    "set_friction",
    "settle",
    "after_solve",
)
"""Stages in order: those up to `prepare` run once, the others in every step."""
STEP_STAGES = STAGES[STAGES.index("prepare") + 1 :]


def acts_in(effect: Effect | type[Effect], stage: str) -> bool:
    """Whether the effect overrides this stage."""
    kind = effect if isinstance(effect, type) else type(effect)
    return getattr(kind, stage) is not getattr(Effect, stage)


def act(stages: Mapping[str, tuple[Effect, ...]], stage: str, world: World, dt_s: float) -> None:
    """Let the effects of a stage of the step act, in order; ``stages`` are from `by_stage`."""
    for effect in stages[stage]:
        getattr(effect, stage)(world, dt_s)


def by_stage(effects: Iterable[Effect]) -> dict[str, tuple[Effect, ...]]:
    """Return for each stage the effects that act in it, in the order given; see `Effect.acts_for_all`."""
    every = tuple(effects)
    acting = {stage: [e for e in every if acts_in(e, stage)] for stage in STAGES}
    for stage in STEP_STAGES:
        for effect in [e for e in acting[stage] if e.acts_for_all][1:]:
            acting[stage].remove(effect)
    return {stage: tuple(found) for stage, found in acting.items()}
