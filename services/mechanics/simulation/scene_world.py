"""Builds the world of a simulation from a scene and its duct: bodies, contacts and collision detection."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from trocar.services.mechanics.bodies.catheter import CatheterBody
from trocar.services.mechanics.bodies.duct import DuctBody
from trocar.services.mechanics.bodies.forceps import ToolBody
from trocar.services.mechanics.collision.pairs import ContactPairs
from trocar.services.mechanics.contact.candidate_search import CandidateSearch
from trocar.services.mechanics.contact.geometry import Bodies
from trocar.services.mechanics.contact.holds import HoldRegistry
from trocar.services.mechanics.contact.seal import IntroducerSeal
from trocar.services.mechanics.contact.squeeze import JawSqueeze
from trocar.services.mechanics.contact.system import STRATEGIES, ContactSystem
from trocar.services.mechanics.effects import Effect, by_stage
from trocar.services.mechanics.reduction import ExactOscillator, Newmark, ReducedDuct
from trocar.services.mechanics.scene import SceneModel
from trocar.services.mechanics.simulation.scene_catheter import scene_rod
from trocar.services.mechanics.simulation.scene_duct import constant_load_n
from trocar.services.mechanics.world import World


def build_world(
    scene: SceneModel, duct: ReducedDuct, effects: tuple[Effect, ...], search: CandidateSearch | None
) -> World:
    """Return everything at rest, the duct in equilibrium with its constant loads."""
    stages = by_stage(effects)
    capacity = scene.contact.capacity
    duct_body = build_duct_body(scene, duct, stages["constant_load_n"], capacity)
    catheter = CatheterBody(
        scene.catheter,
        scene_rod(scene, stages["modify_rod"]),
        may_sleep=scene.sleeping,
        acts_in_next_step=STRATEGIES[scene.contact.model].acts_in_next_step,
    )
    tools = ToolBody(scene.forceps)
    accelerations_m_s2 = (each.body_acceleration_m_s2() for each in stages["body_acceleration_m_s2"])
    system = ContactSystem(Bodies(duct_body, catheter, tools, 0.5 * scene.duct.thickness_m), scene.contact)
    return World(
        scene=scene,
        duct=duct_body,
        catheter=catheter,
        tools=tools,
        system=system,
        holds=HoldRegistry(scene.forceps, system),
        seal=IntroducerSeal(catheter, system),
        squeeze=JawSqueeze(scene.duct, system),
        search=search or CandidateSearch(scene, duct),
        pairs=ContactPairs.zeros(capacity=2 * capacity),  # those of the tools, and of the catheter
        acceleration_m_s2=sum(accelerations_m_s2, np.zeros(3)),
        effects=effects,
    )


def build_duct_body(scene: SceneModel, duct: ReducedDuct, effects: Iterable[Effect], capacity: int) -> DuctBody:
    """Return the duct in equilibrium with the constant loads of ``effects``, for up to ``capacity`` contacts."""
    check_integrator(scene)
    integrator = ExactOscillator if scene.duct.integrator == "exact" else Newmark
    body = DuctBody(duct, integrator(duct.basis.omega_rad_s, duct.damping_ratio), capacity)
    load_n = constant_load_n(effects, duct.mesh)
    if load_n is not None:
        body.set_constant_load(load_n)
    return body


def check_integrator(scene: SceneModel) -> None:
    r"""Reject the exact oscillator for a duct with contacts.

    Contacts act as impulses at the start of a step. A mode whose phase advances by :math:`\theta` in a step, with the
    same impulse in each, rests by its exact solution at :math:`(\theta/2) \cot(\theta/2)` times its static deflection:
    at zero from half a period on, and beyond on the wrong side. By Newmark it rests at the static deflection.
    Raises ValueError that names the key.
    """
    if scene.duct.integrator == "exact" and not scene.duct_alone:
        raise ValueError("duct.integrator: exact is for a duct that nothing touches, contacts need newmark")
