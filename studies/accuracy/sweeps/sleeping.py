"""What a part costs that rests, and whether it can be told when it is woken."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.effects import EFFECTS
from trocar.services.mechanics.reduction import ReducedDuct
from trocar.services.mechanics.scenarios import insertion_scene
from trocar.services.mechanics.scene import SceneModel
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.mechanics.simulation.duct_alone import DuctAlone
from trocar.services.mechanics.simulation.scene_duct import build_scene_duct
from trocar.studies.accuracy.report import costs_us
from trocar.studies.accuracy.study import Draw, Error, Reference, Row, Setting, Tick

TITLE = "What sleeps, and what it costs"
WHAT = (
    "Parts at rest, asleep and kept awake (`sleeping: false`), while no tool is there: a duct alone, and a catheter "
    "beside it. The cost is the part's own share of a tick. Then the part is woken, the duct by a blow, the catheter "
    "by a forceps that presses on it. The reference is the part that was kept awake; the errors are the largest "
    "distance of a point, in the first tick and later, and of the force."
)
COURSE, JUMP, FORCE = "course after waking", "jump in the tick of waking", "force after waking"
LIMIT_US = 1.0
"""Of a part that sleeps, in a tick."""
BLOW_M_S = 1e-3
"""Rate of the lowest mode, in m sqrt(kg) / s; each mode above it has 0.7 of that of the one below."""
COMES_DOWN_M_S = 60e-3
_DUCT, _CATHETER, _TWISTED = "duct alone", "catheter", "catheter with twist"
_ASLEEP, _AWAKE = "asleep", "kept awake"
_TICK_S = 1e-3
_HANGS_AT_M = 60e-3, 40e-3, 0.0
_REST_S, _TOUCHED_AFTER_S = 3.0, 0.05


def settings(draw: Draw) -> Sequence[Setting]:
    """Each part, asleep and kept awake."""
    bodies = draw.pick((_DUCT, _CATHETER), (_DUCT, _CATHETER, _TWISTED), (_DUCT, _CATHETER, _TWISTED))
    return [
        Setting(f"{body}, {state}", {"body": body, "sleeping": state == _ASLEEP}, series=state)
        for body in bodies
        for state in (_ASLEEP, _AWAKE)
    ]


def reference(draw: Draw) -> Reference:
    """Return the courses of parts that never sleep."""
    found = {}
    for setting in settings(draw):
        if not setting.choices["sleeping"]:
            body = str(setting.choices["body"])
            found[f"{body}: places"], found[f"{body}: forces"] = _course(setting, draw)
    return found


def errors(setting: Setting, reference: Reference, draw: Draw) -> dict[str, Error]:
    """Return how far what was woken is from what never slept."""
    body = setting.choices["body"]
    places_m, force_n = _course(setting, draw)
    away_m = np.linalg.norm(places_m - reference[f"{body}: places"], axis=2).max(axis=1)
    told = {COURSE: _apart(float(away_m.max()), "um"), JUMP: _apart(float(away_m[0]), "um")}
    if len(force_n):
        apart_n = np.linalg.norm(force_n - reference[f"{body}: forces"], axis=1)
        told[FORCE] = _apart(float(apart_n.max()), "uN")
    return told


def _apart(value: float, unit: str) -> Error:
    """Return a difference in millionths. Nobody chooses between a duct and a catheter: there is no frontier."""
    return Error(1e6 * value, unit, is_known=False)


def tick(setting: Setting, draw: Draw) -> Tick:
    """Return the part's share of a tick at rest."""
    if setting.choices["body"] == _DUCT:
        return _duct(setting).step
    simulation, _ = _hanging(setting)
    return lambda: simulation.catheter.predict(_TICK_S)


def _course(setting: Setting, draw: Draw) -> tuple[FloatArray, FloatArray]:
    """Return places (t, points, 3) of a part from the tick of waking on, and the forces (t, 3) that a tool felt."""
    ticks = round(draw.pick(0.1, 0.3, 1.0) / _TICK_S)
    if setting.choices["body"] == _DUCT:
        return np.array(list(_struck(_duct(setting), ticks))), np.zeros((0, 3))
    course = list(_touched(*_hanging(setting), ticks))
    return np.array([place for place, _ in course]), np.array([force for _, force in course])


def _duct(setting: Setting) -> DuctAlone:
    """Return a duct that has swung until it is at rest, whether it sleeps then or not."""
    scene = replace(insertion_scene(), effects={}, duct_alone=True, sleeping=bool(setting.choices["sleeping"]))
    alone = DuctAlone(scene, _built(scene))
    _strike(alone)
    _rest(alone.step, alone.is_asleep, setting)
    return alone


def _strike(alone: DuctAlone) -> None:
    alone.state.qdot[:] += BLOW_M_S * 0.7 ** np.arange(alone.state.qdot.size)


def _struck(alone: DuctAlone, ticks: int) -> Iterator[FloatArray]:
    _strike(alone)
    for _ in range(ticks):
        alone.step()
        yield alone.duct.reduced.basis.displacements(alone.state.q)


def _hanging(setting: Setting) -> tuple[Simulation, ToolInputs]:
    """Return a catheter that has hung beside the duct until it is still, tools gone."""
    scene = insertion_scene()
    names = ("gravity", "twist") if setting.choices["body"] == _TWISTED else ("gravity",)
    effects = {name: EFFECTS[name].kind.Settings() for name in names}
    hung = replace(scene.catheter, anchor="clamped", tip_position_m=_HANGS_AT_M, viscous_drag_n_s_m2=0.2)
    scene = replace(scene, catheter=hung, effects=effects, sleeping=bool(setting.choices["sleeping"]))
    simulation, tools = Simulation(scene, _built(scene)), ToolInputs()
    tools.present[:] = False
    _rest(lambda: simulation.step(tools), simulation.catheter.is_asleep, setting)
    return simulation, tools


def _touched(simulation: Simulation, tools: ToolInputs, ticks: int) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Bring a forceps down on the catheter and press it on."""
    tip_m = simulation.catheter.state.position_m[-1].copy()
    tools.present[0] = True
    tools.jaw_angle_rad[:] = 0.3
    for tick in range(ticks):
        above_m = 4e-3 + COMES_DOWN_M_S * (_TOUCHED_AFTER_S - tick * _TICK_S)
        tools.position_m[0] = tip_m + np.array([5e-3, 0.0, above_m])
        simulation.step(tools)
        yield simulation.catheter.state.position_m.copy(), simulation.tool_results.force_n[0].copy()


def _rest(step: Callable[[], None], is_asleep: Callable[[], bool], setting: Setting) -> None:
    """Take steps for longer than a part needs to fall asleep: as many with one that may not."""
    for _ in range(round(_REST_S / _TICK_S)):
        step()
    if is_asleep() != setting.choices["sleeping"]:
        raise RuntimeError(f"{setting.name}: it is not, after {_REST_S:g} s at rest")


def _built(scene: SceneModel) -> ReducedDuct:
    return build_scene_duct(scene, cache_directory() / "bases")


def findings(rows: Sequence[Row]) -> list[str]:
    """Say what sleep costs, and what it saves."""
    cost = costs_us(rows)
    asleep, awake = ([cost[name] for name in cost if name.endswith(state)] for state in (_ASLEEP, _AWAKE))
    if not asleep or not awake:
        return []
    return [
        f"A part that is asleep costs at most {max(asleep):.2g} us (limit: {LIMIT_US:g} us); kept awake, it costs "
        f"{min(awake):.2g} to {max(awake):.2g} us."
    ]
