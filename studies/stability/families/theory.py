"""Methods that must fail by theory, just below and just above where they do."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from trocar.services.mechanics.fem import ElementChoice
from trocar.services.mechanics.rod import rod_energy, straight_rod
from trocar.services.mechanics.rod.semi_implicit import SemiImplicitIntegrator
from trocar.services.mechanics.scene import SceneModel
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.studies.full_model import CondensedStiffness
from trocar.studies.paper_scene import paper_scene
from trocar.studies.published.rods import example_rod
from trocar.studies.published.shells import reference_duct
from trocar.studies.stability.drive import Driven, reduced_duct
from trocar.studies.stability.family import Case, Draw
from trocar.studies.stability.situations import with_catheter

RATIOS = 0.5, 0.9, 0.98, 1.02, 1.1, 2.0
"""Of the step to the limit of the theory."""
PENALTIES = 0.03, 0.1, 10.0, 100.0
"""Of the stiffness m / dt^2, from which on an explicit spring throws a particle back further than it came."""
GROWN = 1e6
PENALTY_STEPS = 800
RATTLES_M_S = 10e-3
STEPS = 3000


def cases(draw: Draw) -> Iterator[Case]:
    """Each method at every ratio to its limit."""
    for ratio in RATIOS if draw.is_long else (0.98, 1.02):
        yield Case(f"central difference at {ratio:g} T/pi", partial(_central_difference, ratio))
        yield Case(f"the paper's particles at {ratio:g} of their limit", partial(_particles, ratio))
    for stiffness in PENALTIES if draw.is_long else ():
        yield Case(f"penalty contact with {stiffness:g} m/dt^2", partial(_penalty, stiffness))


def _judged(ratio: float, growth: float, steps: int) -> Driven:
    """Whether it grew exactly where it had to."""
    return Driven({"theory": float((not growth < GROWN) != (ratio > 1.0))}, repr(growth), steps)


def _central_difference(ratio: float) -> Driven:
    """U'' = -A u from a random start, which has a part in the stiffest mode."""
    model = reference_duct(10, 8, ElementChoice())
    stiffness = CondensedStiffness(model)
    mass = model.free_mass_kg[stiffness.translations]
    dt_s = ratio * stiffness.stable_step_s()
    before = now = np.random.default_rng(1).normal(size=mass.size)
    for step in range(STEPS):
        before, now = now, 2.0 * now - before - dt_s**2 / mass * stiffness.apply(now)
        if not np.abs(now).max() < GROWN:
            return _judged(ratio, math.inf, step)
    return _judged(ratio, float(np.abs(now).max()), STEPS)


def _particles(ratio: float) -> Driven:
    """Semi-implicit Euler as it would be without its sub-steps."""
    properties = example_rod(30)
    integrator = SemiImplicitIntegrator(properties)
    state, no_load = straight_rod(properties, (0, 0, 0), (1, 0, 0)), np.zeros((properties.n_particles, 3))
    state.velocity_m_s[:] = 1e-3 * np.random.default_rng(1).normal(size=(properties.n_particles, 3))
    first_j = rod_energy(integrator.model, state).total_j
    dt_s = ratio * integrator.stable_time_step_s
    integrator.stable_time_step_s = math.inf
    growth = 1.0
    for step in range(STEPS):
        try:
            integrator.predict(state, no_load, dt_s)
        except FloatingPointError:
            growth = math.inf
        if step % 50 == 0:
            growth = max(growth, rod_energy(integrator.model, state).total_j / first_j)
        if not growth < GROWN:
            return _judged(ratio, math.inf, step)
    return _judged(ratio, growth, STEPS)


def _penalty(stiffness: float) -> Driven:
    """A catheter that lies on the wall, held by springs one step late: it comes to rest only on soft ones.

    On stiff ones it rattles, or is thrown so that no part of its motion is possible.
    """
    scene = _lying()
    simulation = Simulation(scene, reduced_duct(scene))
    lightest_kg = float(simulation.catheter.properties.particle_mass_kg()[1:-1].min())
    contact = replace(scene.contact, penalty_stiffness_n_m=stiffness * lightest_kg / 1e-6, penalty_damping_n_s_m=0.0)
    simulation, tools = Simulation(replace(scene, contact=contact), reduced_duct(scene)), ToolInputs()
    tools.present[:] = False
    fastest_m_s, has_touched = 0.0, False
    for step in range(PENALTY_STEPS):
        try:
            simulation.step(tools)
        except FloatingPointError:
            fastest_m_s = math.inf
        if simulation.withheld_s > 0.0 or math.isinf(fastest_m_s):
            fastest_m_s = math.inf
            break
        has_touched = has_touched or bool(simulation.contact_force_n.any())
        if step > PENALTY_STEPS - 100:
            fastest_m_s = max(fastest_m_s, float(np.abs(simulation.catheter.state.velocity_m_s).max()))
    is_as_told = has_touched and (not fastest_m_s < RATTLES_M_S) == (stiffness > 1.0)
    return Driven({"theory": float(not is_as_told)}, repr(fastest_m_s), step)


def _lying() -> SceneModel:
    """The paper's catheter along the bottom of its duct, in touch with it."""
    scene = paper_scene()
    deep_m = scene.duct.radius_m - 0.5 * (scene.duct.thickness_m + scene.catheter.outer_diameter_m)
    return with_catheter(scene, tip_position_m=(24e-3, 0.0, -deep_m))
