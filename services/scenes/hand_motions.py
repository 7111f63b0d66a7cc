"""What a scene's hands do, as text, for who moves the devices and runs none of the mechanics: the simulated ones.

``python -m trocar.services.scenes.hand_motions SCENE [KEY=VALUE ...]`` prints it as JSON: importing what it takes
needs two seconds and a hundred megabytes, which a process that runs at 1 kHz had better not have.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any

from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.scenarios import ToolMotion
from trocar.services.mechanics.scene import ToolScene
from trocar.services.mechanics.simulation.scene_catheter import place_catheter
from trocar.services.runtime.config.scene_findings import print_finding
from trocar.services.scenes.hands import hands_of, out_of_the_way, with_strokes
from trocar.services.scenes.load import load_scene
from trocar.services.scenes.ready import load_surface

STROKES = 8
"""About a minute of them at the pace of the stub, so that its motion is not seen to repeat."""


def hand_motions(scene_name: str, overrides: Iterable[str] = ()) -> list[dict[str, Any]]:
    """Return for each tool of a scene its port and motion, by the names of `trocar.services.gateway.motions.script`.

    Raises ConfigError: one sentence, if scene or surface cannot be used.
    """
    scene = load_scene(scene_name, overrides)
    mesh = load_surface(scene, cache_directory())
    scene = place_catheter(scene, mesh)
    scenario = with_strokes(hands_of(scene, mesh), STROKES)
    return [
        _written(tool, scenario.motions[k] or out_of_the_way(scene, k, mesh)) for k, tool in enumerate(scene.forceps)
    ]


def _written(tool: ToolScene, motion: ToolMotion) -> dict[str, Any]:
    rows = zip(motion.time_s, motion.grip_point_m, motion.roll_rad, motion.jaw_angle_rad, strict=True)
    ratio, _ = tool.handle_range
    breakpoints = [
        {"time_s": time_s, "hip_m": point, "roll_rad": roll, "handle_rad": jaw / ratio}
        for time_s, point, roll, jaw in rows
    ]
    script = {"beyond_hip_m": motion.grip_offset_m, "breakpoints": breakpoints}
    return {"port_m": tool.port_position_m, "motion": script}


if __name__ == "__main__":
    print_finding(lambda scene, overrides: json.dumps(hand_motions(scene, overrides)).encode())
