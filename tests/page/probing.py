"""A probe pressed on walls from soft to hard: ``python -m tests.page.probing docs/probing.jpg``, in three minutes.

The same hand in three rigs with the scene ``probe``, whose ducts differ in nothing but their modulus. What the page
shows while it presses becomes a strip, from soft to hard, and what the arm applies is printed.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import yaml
from PIL import Image

from tests.chromium import Chromium
from tests.page.newcomer import FINER
from tests.rig.conftest import running_rig
from trocar.services.runtime.config.rig import Transport
from trocar.services.scenes.hand_motions import hand_motions
from trocar.services.supervisor.page.page_place import page_file
from trocar.services.visualization.web import build

SIZE = (640, 560)
MODULI_PA = (30e3, 300e3, 3e6)
TOOL = 1
#: The probe is above the wall, touches it, and is as deep as the hand wants it.
TIMES_S = 0.0, 2.0, 4.0
_DRAWS_S = 12.0
_CLOSE_UP = """
const {stage} = trocar.view, reach = 34;
stage.controls.target.set(POINT);
stage.camera.position.set(POINT).add({x: 0.75 * reach, y: -0.55 * reach, z: 0.45 * reach});
stage.controls.update();
"""


def script(directory: Path) -> tuple[Path, list[float]]:
    """Write what both hands do; also return where the probe presses, in m."""
    told = hand_motions("probe", ())
    motions = {name: tool["motion"] for name, tool in zip(("left", "right"), told, strict=True)}
    rows = zip(motions["right"]["breakpoints"][:3], TIMES_S, strict=True)
    motions["right"]["breakpoints"] = [{**row, "time_s": when} for row, when in rows]
    path = directory / "probing.yaml"
    path.write_text(yaml.safe_dump({"loop": False, "motions": motions}))
    return path, motions["right"]["breakpoints"][-1]["hip_m"]


def press(modulus_pa: float) -> tuple[Image.Image, float]:
    """Return what the page shows of a probe that presses, and the force that its arm applies, in N."""
    with tempfile.TemporaryDirectory() as folder:
        directory = Path(folder)
        written, point_m = script(directory)
        hands = [f"gateway.instruments.{k}.arm.settings={{script: {written}}}" for k in (0, 1)]
        wall = f"duct.youngs_modulus_pa={modulus_pa}"
        with (
            running_rig(directory, "probe", [*hands, wall], keeps_solved=True) as rig,
            Chromium(directory / "profile", SIZE) as browser,
        ):
            browser.open(json.loads(page_file(Transport(directory=directory / "bus")).read_text())["address"])
            browser.until(lambda: browser.evaluate("document.querySelector('#view.ready') !== null"), 60, "it loaded")
            browser.evaluate(f"(() => {{{FINER}}})()")
            browser.evaluate(f"(() => {{{_CLOSE_UP.replace('POINT', ', '.join(str(1e3 * x) for x in point_m))}}})()")
            browser.evaluate("document.querySelector('#toggle-dashboard').click()")
            devices = rig.observer.devices
            assert devices is not None
            rig.observer.until(
                lambda: bool(devices) and any(devices[-1].instruments[TOOL].applied_force_n), 60, "the probe touches"
            )
            until_s = time.monotonic() + TIMES_S[-1] + _DRAWS_S
            while time.monotonic() < until_s:
                rig.observer.look()
                time.sleep(0.02)
            browser.screenshot(directory / "shot.png")
            applied = [np.linalg.norm(body.instruments[TOOL].applied_force_n) for body in devices[-1000:]]
            return Image.open(directory / "shot.png").convert("RGB"), float(np.median(applied))


def probing(path: Path) -> list[float]:
    """Write the strip to `path` and return the forces, from soft to hard."""
    pressed = [press(modulus_pa) for modulus_pa in MODULI_PA]
    sheet = Image.new("RGB", (sum(each.width for each, _ in pressed), pressed[0][0].height))
    for k, (each, _) in enumerate(pressed):
        sheet.paste(each, (k * each.width, 0))
    sheet.save(path, quality=85)
    return [force for _, force in pressed]


if __name__ == "__main__":
    if build.main():
        raise SystemExit("the page cannot be built")
    for modulus_pa, force_n in zip(MODULI_PA, probing(Path(sys.argv[1])), strict=True):
        print(f"{modulus_pa / 1e3:g} kPa: {1e3 * force_n:.3g} mN")
