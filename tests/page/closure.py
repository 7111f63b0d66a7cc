"""Jaws shut on the duct beside its mouth: ``python -m tests.page.closure docs/closure.jpg``, in three minutes.

A rig with the scene ``pinch``, finer and with a wall that gives way, whose second hand closes its forceps altogether.
What the page shows before, while they are shut and after becomes a strip, and what the bus says of the forces is
printed: by how much force and torque change from tick to tick, and whether the torque at the handle is what physics
solved.
"""

from __future__ import annotations

import itertools
import json
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from PIL import Image

from tests.chromium import Chromium
from tests.page.portrait import FINEST
from tests.rig.conftest import Rig, running_rig
from trocar.protocol.bodies import GatewayState, PhysicsState
from trocar.services.runtime.config.rig import Transport
from trocar.services.scenes.hand_motions import hand_motions
from trocar.services.supervisor.page.page_place import page_file
from trocar.services.visualization.web import build

SIZE = (720, 640)
WALL = ("duct.n_around=32", "duct.n_along=40", "effects.softening={}")
TOOL = 1
TIMES_S = 0.0, 2.0, 20.0, 28.0, 48.0, 52.0
"""The jaws come, are there, begin to close, are shut, begin to open, and are open; then all again."""
OPEN = 0.98
"""Part of the opening before the jaws close."""
SHUT_RAD = 0.05
SCALE_FULL = 0.999
_CLOSE_UP = """
const {stage} = trocar.view, reach = 28;
stage.controls.target.set(POINT);
stage.camera.position.set(POINT).add({x: 0.75 * reach, y: -0.45 * reach, z: 0.6 * reach});
stage.controls.update();
"""


@dataclass
class Forces:
    """What the bus said of the tool that closes, tick by tick."""

    ticks: list[int] = field(default_factory=list)
    force_n: list[tuple[float, float, float]] = field(default_factory=list)
    torque_nm: list[float] = field(default_factory=list)
    handle_rad: list[float] = field(default_factory=list)
    is_full: list[bool] = field(default_factory=list)
    solved: dict[int, float] = field(default_factory=dict)

    def look(self, rig: Rig) -> None:
        """Take on what has come."""
        for frame in rig.observer.bus.drain("gateway.state"):
            body: GatewayState = frame.body
            tool = body.instruments[TOOL]
            self.ticks.append(body.tick)
            self.force_n.append(tool.applied_force_n)
            self.torque_nm.append(tool.applied_grasp_torque_nm)
            self.handle_rad.append(tool.handle_angle_rad)
            self.is_full.append(tool.force_scale > SCALE_FULL)
        for frame in rig.observer.bus.drain("physics.state"):
            state: PhysicsState = frame.body
            self.solved[state.tick] = state.reactions()[TOOL].grasp_torque_nm

    def told(self) -> dict[str, float]:
        """Return the largest changes in a tick, and the torque, where forces are not faded."""
        full = np.array(self.is_full)
        near = (np.diff(self.ticks) == 1) & full[1:] & full[:-1]
        force = np.linalg.norm(np.diff(np.array(self.force_n), axis=0), axis=1)[near]
        torque = np.abs(np.diff(self.torque_nm))[near]
        shut = np.flatnonzero(full & (np.array(self.handle_rad) < SHUT_RAD))
        pairs = [(self.torque_nm[k], self.solved[self.ticks[k]]) for k in shut if self.ticks[k] in self.solved]
        applied, solved = np.median(np.array(pairs), axis=0)
        return {
            "ticks with full force": float(full.sum()),
            "largest change of force in a tick, N": float(force.max()),
            "largest change of torque in a tick, mN m": 1e3 * float(torque.max()),
            "torque at the handle when shut, mN m": 1e3 * float(applied),
            "torque on the jaws that physics solved, mN m": 1e3 * float(solved),
        }


def script(directory: Path, overrides: tuple[str, ...]) -> tuple[Path, list[float]]:
    """Write what both hands do; also return the point that the jaws close on, in m."""
    told = hand_motions("pinch", [each for each in overrides if each.startswith("duct")])
    motions: dict[str, Any] = {}
    for name, tool in zip(("left", "right"), told, strict=True):
        motions[name] = tool["motion"]
    above, open_, _ = motions["right"]["breakpoints"][:3]
    shut = {**open_, "handle_rad": 0.0}
    rows = zip((above, open_, open_, shut, shut, open_), TIMES_S, strict=True)
    motions["right"]["breakpoints"] = [{**row, "time_s": when} for row, when in rows]
    path = directory / "closure.yaml"
    path.write_text(yaml.safe_dump({"loop": True, "motions": motions}))
    return path, open_["hip_m"]


def is_open(handle_rad: list[float]) -> bool:
    """Whether the handle, (ticks,), is as far open as it has been."""
    return handle_rad[-1] > OPEN * max(handle_rad)


def is_shut(handle_rad: list[float]) -> bool:
    """Whether the handle, (ticks,), is shut."""
    return handle_rad[-1] < SHUT_RAD


def until(rig: Rig, forces: Forces, there: Callable[[list[float]], bool]) -> None:
    """Look until the handle is where it is wanted."""
    deadline = time.monotonic() + 8.0 * TIMES_S[-1]
    while not (forces.handle_rad and there(forces.handle_rad)):
        assert time.monotonic() < deadline, f"the handle is at {forces.handle_rad[-1:]} rad"
        time.sleep(0.01)
        forces.look(rig)


def closure(path: Path) -> dict[str, float]:
    """Write the strip to `path` and return what the bus said."""
    forces, pictures = Forces(), []
    with tempfile.TemporaryDirectory() as folder:
        directory = Path(folder)
        written, point_m = script(directory, WALL)
        hands = [
            f"gateway.instruments.{k}.{part}.settings.{key}={value}"
            for k, part in itertools.product((0, 1), ("arm", "grasp"))
            for key, value in (("script", written), ("pace", 1.0))
        ]
        with (
            running_rig(directory, "pinch", [*hands, *WALL], topics=("physics.state",)) as rig,
            Chromium(directory / "profile", SIZE) as browser,
        ):
            browser.open(json.loads(page_file(Transport(directory=directory / "bus")).read_text())["address"])
            browser.until(lambda: browser.evaluate("document.querySelector('#view.ready') !== null"), 60, "it loaded")
            browser.evaluate(f"(() => {{{FINEST}}})()")
            browser.evaluate(f"(() => {{{_CLOSE_UP.replace('POINT', ', '.join(str(1e3 * x) for x in point_m))}}})()")
            browser.evaluate("document.querySelector('#toggle-dashboard').click()")
            until(rig, forces, is_shut)
            for stage in (is_open, is_shut, is_open):
                until(rig, forces, stage)
                shot = directory / "shot.png"
                browser.screenshot(shot)
                pictures.append(Image.open(shot).convert("RGB"))
    sheet = Image.new("RGB", (sum(each.width for each in pictures), pictures[0].height))
    for k, each in enumerate(pictures):
        sheet.paste(each, (k * each.width, 0))
    sheet.save(path, quality=85)
    return forces.told()


if __name__ == "__main__":
    if build.main():
        raise SystemExit("the page cannot be built")
    for what, value in closure(Path(sys.argv[1])).items():
        print(f"{what}: {value:.4g}")
