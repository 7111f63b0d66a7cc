"""The table of effects: the one place that names them all, in the order in which they act.

A new effect is one file in this folder and one row here.
"""

from __future__ import annotations

from dataclasses import dataclass

from trocar.services.mechanics.effects.anisotropy import Anisotropy
from trocar.services.mechanics.effects.base import STAGES, Effect, act, acts_in, by_stage
from trocar.services.mechanics.effects.clip import ClipEffect
from trocar.services.mechanics.effects.friction import Friction
from trocar.services.mechanics.effects.gallstones import Gallstones
from trocar.services.mechanics.effects.grasp_slip import GraspSlip
from trocar.services.mechanics.effects.gravity import Gravity
from trocar.services.mechanics.effects.hyperelasticity import Hyperelasticity
from trocar.services.mechanics.effects.insufflation import Insufflation
from trocar.services.mechanics.effects.large_rotations import LargeRotations
from trocar.services.mechanics.effects.mucus_drag import MucusDrag
from trocar.services.mechanics.effects.nonlinear_membrane import NonlinearMembrane
from trocar.services.mechanics.effects.self_contact import SelfContact
from trocar.services.mechanics.effects.softening import Softening
from trocar.services.mechanics.effects.twist import Twist
from trocar.services.mechanics.effects.viscoelasticity import Viscoelasticity
from trocar.services.mechanics.scene import SceneModel
from trocar.services.messages.nearest_word import did_you_mean


@dataclass(frozen=True, slots=True)
class EffectEntry:
    """One row of the table."""

    kind: type[Effect]
    what: str

    @property
    def stages(self) -> tuple[str, ...]:
        """The stages in which the effect acts."""
        return tuple(stage for stage in STAGES if acts_in(self.kind, stage))


EFFECTS: dict[str, EffectEntry] = {
    "anisotropy": EffectEntry(Anisotropy, "a wall stiffer round the duct than along it"),
    "large_rotations": EffectEntry(LargeRotations, "a duct that keeps its shape when it is bent far"),
    "insufflation": EffectEntry(Insufflation, "gas pressure outside against the pressure in the lumen"),
    "gravity": EffectEntry(Gravity, "weight of catheter, stones and, if wanted, wall"),
    "twist": EffectEntry(Twist, "torsion of the catheter; rest curvature turns with it"),
    "viscoelasticity": EffectEntry(
        Viscoelasticity, "a wall that relaxes: Prony terms on modes and what they leave out"
    ),
    "softening": EffectEntry(Softening, "a wall that gives way where it is squeezed"),
    "nonlinear_membrane": EffectEntry(NonlinearMembrane, "a wall that stiffens as it stretches"),
    "hyperelasticity": EffectEntry(Hyperelasticity, "tissue that stiffens as it is stretched: laws of the membrane"),
    "gallstones": EffectEntry(Gallstones, "rigid spheres that catheter and wall push about"),
    "self_contact": EffectEntry(SelfContact, "the catheter touching itself"),
    "clip": EffectEntry(ClipEffect, "a clip on the duct that presses its wall on the catheter and holds it"),
    "mucus_drag": EffectEntry(MucusDrag, "viscous film between catheter and wall"),
    "friction": EffectEntry(Friction, "Coulomb friction, static and kinetic, in every contact"),
    "grasp_slip": EffectEntry(GraspSlip, "a grasp carries no more than its grip friction"),
}


def build_effects(scene: SceneModel) -> dict[str, Effect]:
    """Construct the effects that the scene names, in the order of the table.

    Raises ValueError: an unknown effect, settings of another effect, or an invalid quality ladder.
    """
    for name, settings in scene.effects.items():
        if name not in EFFECTS:
            raise ValueError(f"effects.{name}: there is no such effect; known: {', '.join(EFFECTS)}")
        wanted = EFFECTS[name].kind.Settings
        if type(settings) is not wanted:
            raise ValueError(f"effects.{name}: takes {wanted.__name__}, not {type(settings).__name__}")
    check_ladder(scene)
    check_bodies(scene)
    return {name: entry.kind(scene.effects[name], scene) for name, entry in EFFECTS.items() if name in scene.effects}


def check_bodies(scene: SceneModel) -> None:
    """Check that the scene has the bodies that its effects act on.

    Raises ValueError: one sentence that begins with the key.
    """
    for name in scene.effects if scene.duct_alone else ():
        if not EFFECTS[name].kind.of_wall:
            able = ", ".join(each for each, entry in EFFECTS.items() if entry.kind.of_wall)
            raise ValueError(
                f"effects.{name}: acts on nothing where there is but a duct; these act on its wall: {able}"
            )


def check_ladder(scene: SceneModel) -> None:
    """Check the quality ladder, and that the scene has its essential effects.

    Raises ValueError: one sentence that begins with the key.
    """
    for name in scene.essential:
        if name not in scene.effects:
            raise ValueError(f"essential: the scene has no effect {name!r}")
    for k, level in enumerate(scene.quality):
        for name in level.without:
            if wrong := _cannot_rest(name, scene):
                raise ValueError(f"quality.{k}.without: {wrong}")


def _cannot_rest(name: str, scene: SceneModel) -> str:
    if name not in scene.effects:
        return f"the scene has no effect {name!r}{did_you_mean(name, scene.effects)}"
    if name in scene.essential:
        return f"{name} is essential"
    if not EFFECTS[name].kind.can_rest:
        able = ", ".join(each for each, entry in EFFECTS.items() if entry.kind.can_rest)
        return f"{name} cannot rest while the scene runs; these can: {able}"
    return ""


__all__ = [
    "EFFECTS",
    "STAGES",
    "Effect",
    "EffectEntry",
    "act",
    "build_effects",
    "by_stage",
    "check_bodies",
    "check_ladder",
]
