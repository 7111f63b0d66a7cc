"""A catheter through the cut, its clip open and closed: ``python -m tests.visualization.cut_and_clip FILE`` draws it.

The scene ``cholangiography`` with its simulated hands, drawn without a window; then the hands are taken away and the
clip closes. What is judged is looked at: wall, lips, legs.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from PIL import Image

from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.effects.clip import ClipEffect
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.scenes import load_duct, load_scene
from trocar.services.scenes.hands import hands_of
from trocar.services.visualization.picture import Picture, PictureLayout
from trocar.services.visualization.render import Renderer

SIZE = (640, 420)
LOOKED_AT_M, EYE_M = (0.030, 0.0, 0.0), (0.049, -0.0255, 0.031)
CLOSES_TICKS = 500


def draw(path: Path) -> None:
    """Write both pictures, side by side."""
    scene = load_scene("cholangiography")
    duct = load_duct(scene, cache_directory(), lambda *_: None)
    simulation, tools = Simulation(scene, duct), ToolInputs()
    hands = hands_of(simulation.scene, duct.mesh)
    for tick in range(round(1000 * hands.duration_s)):
        hands.write_inputs(1e-3 * tick, tools)
        simulation.step(tools)
    clip, renderer, layout = simulation.effects["clip"], Renderer(off_screen=True, size=SIZE), _layout(simulation)
    assert isinstance(clip, ClipEffect)
    shots = [_shot(renderer, layout, simulation)]
    tools.present[:], clip.state.is_closed = False, True
    for _ in range(CLOSES_TICKS):
        simulation.step(tools)
    shots.append(_shot(renderer, layout, simulation))
    sheet = Image.new("RGB", (2 * SIZE[0], SIZE[1]))
    for k, each in enumerate(shots):
        sheet.paste(each, (k * SIZE[0], 0))
    sheet.save(path, quality=80)


def _layout(simulation: Simulation) -> PictureLayout:
    mesh, scene = simulation.duct.reduced.mesh, simulation.scene
    rims = [tuple(int(node) for node in mesh.vertex_sets[name]) for name in ("mouth", "clamped")]
    return PictureLayout(
        epoch=1, scene="cholangiography", rest_m=mesh.vertices_m.astype(np.float32), triangles=mesh.triangles,
        thickness_m=scene.duct.thickness_m, mouth=rims[0], clamped=rims[1],
        n_particles=len(simulation.catheter.state.position_m),
        catheter_radius_m=0.5 * scene.catheter.outer_diameter_m, tools=(),
        bars=simulation.effects["clip"].bars(mesh),
    )  # fmt: skip


def _shot(renderer: Renderer, layout: PictureLayout, simulation: Simulation) -> Image.Image:
    picture = Picture(1, points_m=simulation.duct.surface_m().astype(np.float32))
    picture.centreline_m = simulation.catheter.state.position_m.astype(np.float32)
    renderer.update(layout, picture)
    camera = renderer.plotter.camera
    camera.focal_point, camera.position, camera.up, camera.clipping_range = (
        LOOKED_AT_M,
        EYE_M,
        (0.0, 0.0, 1.0),
        (5e-3, 0.5),
    )
    return Image.fromarray(renderer.image())


if __name__ == "__main__":
    draw(Path(sys.argv[1]))
