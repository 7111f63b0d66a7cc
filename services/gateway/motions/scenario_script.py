"""Scenarios of the mechanics as scripts of a hand: the same data drives its tests and the devices here."""

from __future__ import annotations

from trocar.services.gateway.motions.script import Breakpoint, Motion, Player
from trocar.services.mechanics.scenarios import SCENARIOS
from trocar.services.messages.nearest_word import did_you_mean
from trocar.services.runtime.config.rig import Vector3
from trocar.services.runtime.errors import ConfigError


def scenario_player(name: str, index: int, port_m: Vector3, pace: float = 1.0) -> Player:
    """Return the player of instrument `index` in a scenario; at its end the hand holds still.

    Raises ConfigError naming the known scenarios, or if this one has no motion for the instrument.
    """
    if name not in SCENARIOS:
        near = did_you_mean(name, SCENARIOS)
        raise ConfigError(f"there is no scenario {name!r}; known: {', '.join(SCENARIOS)}{near}")
    scenario = SCENARIOS[name]()
    motion = scenario.motions[index] if index < len(scenario.motions) else None
    if motion is None:
        raise ConfigError(f"scenario {name!r} has no motion for instrument number {index}")
    ratio, _ = scenario.scene.forceps[index].handle_range
    rows = zip(motion.time_s, motion.grip_point_m, motion.roll_rad, motion.jaw_angle_rad, strict=True)
    breakpoints = tuple(
        Breakpoint(time_s=time_s, hip_m=point, roll_rad=roll, handle_rad=jaw / ratio)
        for time_s, point, roll, jaw in rows
    )
    return Player(
        Motion(beyond_hip_m=motion.grip_offset_m, breakpoints=breakpoints), loop=False, port_m=port_m, pace=pace
    )
