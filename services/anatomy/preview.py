"""A picture of what was made: the duct with its ends by name, the catheter, and where the tools come from."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from trocar.services.anatomy.making import MadeAnatomy
from trocar.services.anatomy.proposal import BEFORE_MOUTH_M
from trocar.services.files.atomic_file import atomic_file
from trocar.services.mechanics.surface.opening import mouth_opening
from trocar.services.start.graphics_libraries import check_graphics_libraries

_SIZE = (1400, 700)
_COLOURS = {"mouth": "#1b7f3b", "held": "#b3261e", "free": "#555555"}
_SHOWN_M = 30e-3
"""Of the catheter, and of each tool's shaft."""


def draw_preview(made: MadeAnatomy, path: Path) -> None:
    """Write a picture from the front and from the patient's left, in the scene's axes.

    Raises ModuleNotFoundError without pyvista; RuntimeError if this machine cannot draw.
    """
    import pyvista

    check_graphics_libraries()
    plotter = pyvista.Plotter(off_screen=True, window_size=list(_SIZE), shape=(1, 2), border=False)
    try:
        for column, (view, title) in enumerate(((_front(made), "from the front"), (_left(made), "from the left"))):
            plotter.subplot(0, column)
            _add_scene(plotter, made)
            plotter.add_text(title, font_size=10, color="black")
            plotter.set_background("white")
            plotter.view_vector(view, viewup=_up(made))
            plotter.camera.zoom(1.2)
        with atomic_file(path) as half:
            plotter.screenshot(half)
    finally:
        plotter.close()


def _add_scene(plotter: Any, made: MadeAnatomy) -> None:
    import pyvista

    mesh, out = made.placed, -mouth_opening(made.placed).inward
    plotter.add_mesh(
        pyvista.PolyData.from_regular_faces(1e3 * mesh.vertices_m, mesh.triangles),
        color="#d9a08f",
        opacity=0.75,
        smooth_shading=True,
    )
    for line in made.duct.lines:
        plotter.add_mesh(
            pyvista.lines_from_points(1e3 * (line.points_m - made.origin_m) @ made.axes.T), color="black", line_width=2
        )
    for name in made.names:
        rim = 1e3 * mesh.vertices_m[mesh.vertex_sets[name]]
        kind = "mouth" if name == made.choice.mouth else "held" if name in made.choice.held else "free"
        plotter.add_mesh(pyvista.lines_from_points(rim, close=True), color=_COLOURS[kind], line_width=6)
        plotter.add_point_labels(
            [rim.mean(axis=0)],
            [f"{name} ({kind})"],
            font_size=14,
            text_color=_COLOURS[kind],
            shape=None,
            show_points=False,
            always_visible=True,
        )
    mouth_m = mesh.vertices_m[mesh.vertex_sets["mouth"]].mean(axis=0)
    shaft = np.stack([mouth_m + BEFORE_MOUTH_M * out, mouth_m + (BEFORE_MOUTH_M + _SHOWN_M) * out])
    plotter.add_mesh(pyvista.lines_from_points(1e3 * shaft), color="#1f4e9c", line_width=5)
    for k, port in enumerate(made.ports_m):
        target = mouth_m + (32e-3 if k == 0 else -12e-3) * out
        towards = (np.array(port) - target) / float(np.linalg.norm(np.array(port) - target))
        ends = 1e3 * np.stack([target + 6e-3 * towards, target + (6e-3 + _SHOWN_M) * towards])
        plotter.add_mesh(pyvista.lines_from_points(ends), color="#777777", line_width=4)
        plotter.add_point_labels(
            ends[1:], [f"tool {k}"], font_size=12, text_color="#777777", shape=None, show_points=False
        )


def _front(made: MadeAnatomy) -> tuple[float, ...]:
    return tuple((made.axes @ np.array([0.0, -1.0, 0.0])).tolist())


def _left(made: MadeAnatomy) -> tuple[float, ...]:
    return tuple((made.axes @ np.array([1.0, 0.0, 0.0])).tolist())


def _up(made: MadeAnatomy) -> tuple[float, ...]:
    """Return the direction to the patient's head."""
    return tuple((made.axes @ np.array([0.0, 0.0, 1.0])).tolist())
