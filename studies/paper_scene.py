"""The scene of the paper that the project follows, for comparison."""

from __future__ import annotations

from dataclasses import replace

from trocar.services.mechanics.effects.gravity import GravitySettings
from trocar.services.mechanics.scenarios import insertion_scene
from trocar.services.mechanics.scene import ContactSettings, SceneModel


def paper_scene() -> SceneModel:
    """The set-up of Basdogan, Ho and Srinivasan (2001), as far as its text fixes it.

    Their bending triangle on CST, bare modes under Newmark, particles under semi-implicit Euler, penalty contact
    without friction, jaws that hold as soon as both touch. At a tick of 1 ms a particle of 3 mg bears a contact
    stiffness of about 1 N/m.
    """
    scene = insertion_scene()
    left, right = (each.jaws for each in scene.forceps if each.jaws)
    return replace(
        scene,
        duct=replace(scene.duct, membrane="cst", bending="tocher", residual="none", n_modes=60),
        catheter=replace(
            scene.catheter,
            integrator="semi_implicit",
            internal_damping_s=0.0,
            viscous_drag_n_s_m2=0.5,
            introducer_seal_friction_n=0.0,
        ),
        forceps=(replace(left, grasp_torque_nm=1e-9), replace(right, grasp_torque_nm=1e-9)),
        contact=ContactSettings(model="penalty", penalty_stiffness_n_m=1.0, penalty_damping_n_s_m=1e-3),
        effects={"gravity": GravitySettings()},
    )
