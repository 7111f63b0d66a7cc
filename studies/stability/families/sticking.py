"""What sticks, sticks: break-away of the seal at any speed and step, no creep, no fading of what is held."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.scene import SceneModel
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.studies.stability.drive import Driven, reduced_duct
from trocar.studies.stability.family import Case, Draw
from trocar.studies.stability.hands import HandMotions, least_jerk
from trocar.studies.stability.situations import LEAD_STEPS, approaching, threaded, with_catheter
from trocar.studies.stability.strokes import at_step

SPEEDS_M_S = 1e-3, 10e-3, 50e-3
STEPS_MS = 1.0, 0.25, 0.1
WATCHED_S = {1.0: 60.0, 0.25: 15.0, 0.1: 6.0}
SETTLED_S = 0.5
AXIS = np.array([1.0, 0.0, 0.0])


def cases(draw: Draw) -> Iterator[Case]:
    """At 1, 0.25 and 0.1 ms."""
    for step in STEPS_MS if draw.is_long else (1.0,):
        watched_s = WATCHED_S[step] if draw.is_long else 0.5
        for speed in SPEEDS_M_S if draw.is_long else (50e-3,):
            yield Case(f"seal broken at {1e3 * speed:g} mm/s, {step:g} ms", partial(_broken, speed, 1e-3 * step))
        yield Case(f"catheter hanging in its seal, {step:g} ms", partial(_hanging, 1e-3 * step, watched_s))
        yield Case(f"catheter pulled back in the duct, {step:g} ms", partial(_pulled, 1e-3 * step, watched_s))


def _broken(speed_m_s: float, dt_s: float) -> Driven:
    """The force on the hand while the catheter slides through its seal, against the seal's friction."""
    start = approaching()
    scene = replace(start.scene, effects={name: start.scene.effects[name] for name in ("friction", "grasp_slip")})
    ramp_s = 0.2
    steps = round((ramp_s + 5e-3 / speed_m_s) / 1e-3)
    time_s = 1e-3 * np.arange(1, steps + 1)
    way_m = speed_m_s * np.where(time_s < ramp_s, 0.5 * time_s**2 / ramp_s, time_s - 0.5 * ramp_s)
    hands = start.hands.then(steps).moved(0, np.outer(way_m, AXIS), LEAD_STEPS)
    simulation, force_n = _forces(scene, at_step(hands, dt_s), dt_s)
    sliding_n = float(np.mean(np.abs(force_n[-len(force_n) // 5 :] @ AXIS)))
    seal_n = scene.catheter.introducer_seal_friction_n
    return _driven({"law": abs(sliding_n / seal_n - 1.0)}, simulation, len(force_n))


def _hanging(dt_s: float, watched_s: float) -> Driven:
    """Pointing down, its weight below the seal's friction."""
    scene = with_catheter(approaching().scene, direction=(0.0, 0.0, -1.0), tip_position_m=(80e-3, 0.0, 0.0))
    simulation, tools = Simulation(scene, reduced_duct(scene)), ToolInputs()
    tools.present[:] = False
    moved_m = _creep(simulation, tools, dt_s, watched_s)
    return _driven({"creep": moved_m}, simulation, round(watched_s / dt_s))


def _pulled(dt_s: float, watched_s: float) -> Driven:
    """Held by the jaws, 0.3 mm back: less than what breaks it away. What the hand feels then stays."""
    start = threaded()
    hands = start.hands.then(200).moved(0, least_jerk(0.3e-3, AXIS, 5e-3), LEAD_STEPS)
    simulation, _ = _forces(start.scene, at_step(hands, dt_s), dt_s)
    tools = ToolInputs()
    hands.write(len(hands) - 1, tools)
    for _ in range(round(SETTLED_S / dt_s)):
        simulation.step(tools, dt_s)
    before_n = float(np.linalg.norm(simulation.tool_results.force_n[0]))
    moved_m = _creep(simulation, tools, dt_s, watched_s)
    after_n = float(np.linalg.norm(simulation.tool_results.force_n[0]))
    lost = abs(after_n / before_n - 1.0) * 60.0 / watched_s if before_n > 0.0 else np.inf
    return _driven({"creep": moved_m, "relaxation": lost}, simulation, round(watched_s / dt_s))


def _forces(scene: SceneModel, hands: HandMotions, dt_s: float) -> tuple[Simulation, FloatArray]:
    """Force on tool 0 where it holds, in every step, (T, 3); at J it would be more, by the lever about the port."""
    simulation, tools = Simulation(scene, reduced_duct(scene)), ToolInputs()
    force_n = np.zeros((len(hands), 3))
    for step in range(len(hands)):
        hands.write(step, tools)
        simulation.step(tools, dt_s)
        force_n[step] = simulation.contact_force_n[simulation.contacts.tool[: simulation.contacts.n_contacts] == 0].sum(
            axis=0
        )
    return simulation, force_n


def _creep(simulation: Simulation, tools: ToolInputs, dt_s: float, watched_s: float) -> float:
    """Motion of any particle in so long, after half a second to settle, scaled to a minute."""
    for _ in range(round(SETTLED_S / dt_s)):
        simulation.step(tools, dt_s)
    before = simulation.catheter.state.position_m.copy()
    for _ in range(round(watched_s / dt_s)):
        simulation.step(tools, dt_s)
    moved_m = float(np.linalg.norm(simulation.catheter.state.position_m - before, axis=1).max())
    return moved_m * 60.0 / watched_s


def _driven(figures: dict[str, float], simulation: Simulation, steps: int) -> Driven:
    return Driven(figures, simulation.catheter.state.position_m.tobytes().hex(), steps)
