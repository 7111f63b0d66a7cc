"""The force of an insertion through a running rig, beside the mechanics alone in the same poses, tick by tick.

``python -m tests.rig.force_tracking`` runs the rig, with simulated arms, and says how far apart they are.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from protocol.bodies import GatewayState, PhysicsState
from services.cache_directory import cache_directory
from services.mechanics.arrays import FloatArray
from services.mechanics.bodies.forceps.kinematics import jaw_angle_from_handle
from services.mechanics.scenarios import insertion
from services.mechanics.scene.tools import ToolInputs
from services.mechanics.simulation import Simulation
from services.mechanics.simulation.scene_duct import build_scene_duct
from services.runtime.loop import LoopMeter, TickClock
from tests.rig.conftest import running_rig

PACE = 0.5
INSERTED_M = 20e-3
WITHIN = 0.05
#: From a pose to the force that the arm applies: a tick through haptics and physics, and the next one's.
LATE = 2


@dataclass(frozen=True)
class Tracked:
    """How far apart forces are, as shares of the largest of each tool; (tools, ticks).

    Attributes
    ----------
    solved : (tools, ticks)
        What physics found, against the mechanics alone.
    applied : (tools, ticks)
        What the arms applied two ticks later.
    lost : int
        Ticks of the rig's clock that nobody told of, or that were not simulated one by one.
    """

    solved: FloatArray
    applied: FloatArray
    lost: int

    def lines(self) -> list[str]:
        """Say it."""
        rows = [f"{self.solved.shape[1]} ticks, {self.lost} of them lost by the rig or by who looked on"]
        for tool, what in enumerate(("catheter", "wall")):
            for name, apart in (("solved", self.solved), ("applied", self.applied)):
                share, most = np.mean(apart[tool] < WITHIN), apart[tool].max()
                rows.append(f"{what}, {name}: {100 * share:.1f} % of ticks within 5 %, at worst {100 * most:.1f} %")
        return rows


def track(directory: Path, pace: float = PACE) -> Tracked:
    """Run the insertion in a rig of its own in `directory`, until it is done, and compare."""
    settings = f"{{scenario: insertion, pace: {pace}}}"
    overrides = [f"gateway.instruments.{i}.{what}.settings={settings}" for i in (0, 1) for what in ("arm", "grasp")]
    overrides += [f"contracts.loops.{loop}.stop_miss_ratio=1" for loop in ("gateway", "haptics", "physics")]
    with running_rig(directory, "insertion", overrides, keeps_solved=True) as rig:
        solved, devices = rig.observer.solved or [], rig.observer.devices or []
        rig.observer.until(lambda: _is_in(solved), 30.0 / pace, "20 mm inserted")
    return compare(devices, solved)


def _is_in(solved: list[PhysicsState]) -> bool:
    return bool(solved) and solved[-1].catheter.inserted_length_m >= INSERTED_M


def compare(said: list[GatewayState], states: list[PhysicsState]) -> Tracked:
    """Step the mechanics alone through the poses that physics was told of, and compare forces."""
    devices = {body.tick: body for body in said}
    solved = [body for body in states if body.tick in devices]
    alone = _alone(devices, solved)
    found = np.array([[tool.force_n for tool in body.reactions()] for body in solved])
    largest = np.linalg.norm(alone, axis=2).max(axis=0)
    later = [(k, devices.get(body.tick + LATE)) for k, body in enumerate(solved)]
    answered = [k for k, device in later if device is not None]
    applied = np.array([[tool.applied_force_n for tool in device.instruments] for _, device in later if device])
    ticks = np.diff([body.tick for body in solved])
    return Tracked(
        (np.linalg.norm(found - alone, axis=2) / largest).T,
        (np.linalg.norm(applied - alone[answered], axis=2) / largest).T,
        int(np.sum(ticks - 1)),
    )


def _alone(devices: dict[int, GatewayState], solved: list[PhysicsState]) -> FloatArray:
    """Return forces (ticks, tools, 3) in N of the same steps without processes between."""
    scene = insertion().scene
    simulation = Simulation(scene, build_scene_duct(scene, cache_directory() / "bases"))
    tools, clock, forces = ToolInputs(), TickClock(LoopMeter(1000.0)), np.empty((len(solved), 2, 3))
    for k, body in enumerate(solved):
        for i, (device, forceps) in enumerate(zip(devices[body.tick].instruments, scene.forceps, strict=True)):
            tools.position_m[i], tools.roll_rad[i] = device.position_m, device.roll_rad
            if forceps.jaws is not None:
                ratio, most = forceps.jaws.jaw_ratio, forceps.jaws.jaw_max_angle_rad
                tools.jaw_angle_rad[i] = jaw_angle_from_handle(device.handle_angle_rad, ratio, most)
        for _ in range(clock.steps(body.tick)):
            simulation.step(tools)
        forces[k] = simulation.tool_results.force_n
    return forces


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as made:
        print("\n".join(track(Path(made)).lines()))
