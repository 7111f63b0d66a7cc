"""Overlay of a window's picture: the lens, the state of the rig, forces, figures, scales, help."""

from __future__ import annotations

import numpy as np
import pyvista as pv
from vtkmodules.vtkRenderingCore import vtkActor2D, vtkPolyDataMapper2D

from trocar.services.visualization.picture import Picture, PictureLayout, ToolShape
from trocar.services.visualization.scales import scales

HELP = "1 scope 2 mouth 3 side 4 top 5 ports  M mirror F forces A aim S strain L lens  drag turns  H help  Q ends"
_LENS = ((0.56, 0), (0.61, 140), (0.66, 255), (4.0, 255))  # radius over the shorter side, opacity: as in `lens.js`
_STATES = {"running": "#67d1bd", "ready": "#67d1bd", "degraded": "#eab54d", "safe_stop": "#f0695a"}
_QUIET = "#d9cdc8"


class Overlay:
    """Texts in the corners, and the round picture of a laparoscope: above the scene, which is built anew under it."""

    def __init__(self, plotter: pv.Plotter) -> None:
        self._window = plotter.render_window
        self._lens = vtkActor2D()
        self._lens.SetMapper(_lens(1, 1))
        self._size = (0, 0)
        self.shows_lens = self.shows_help = True
        # Kept here, as VTK gives back another object of a property that Python has let go.
        self._styles = {name: _style() for name in ("tools", "figures", "rig", "help")}
        self._styles["figures"].justification_horizontal = "right"
        self._texts = {name: pv.Text() for name in self._styles}
        for name, text in self._texts.items():
            text.prop = self._styles[name]  # one that is given to the constructor is forgotten (pyvista 0.49)
        self.shows_scales = False
        self._scales = scales()
        for actor in (self._lens, *self._texts.values(), *self._scales):
            plotter.add_actor(actor, reset_camera=False, pickable=False, render=False)

    def follow_size(self) -> None:
        """Update the layout if the window's size has changed."""
        width, height = self._window.GetSize()
        self._lens.SetVisibility(self.shows_lens)
        self._texts["help"].SetVisibility(self.shows_help)
        for scale in self._scales:
            scale.SetVisibility(self.shows_scales)
        if (width, height) == self._size:
            return
        self._size = (width, height)
        self._lens.SetMapper(_lens(width, height))
        places = {"tools": (16, height - 60), "figures": (width - 16, height - 78), "rig": (16, 40), "help": (16, 14)}
        for name, (x, y) in places.items():
            self._texts[name].position = x, y
            self._styles[name].font_size = max(9, min(15, width // 68))

    def tell(self, layout: PictureLayout, picture: Picture, rate_hz: float) -> None:
        """Write the figures of a picture."""
        sizes = np.linalg.norm(picture.force_n, axis=1)
        rows = zip(layout.tools, sizes, picture.jaw_rad, strict=True)
        lines = [f"{tool.name:<8}{_force(float(n)):>9}{_opening(tool, float(jaw))}" for tool, n, jaw in rows]
        self._texts["tools"].input = "\n".join(lines)
        inserted = f"inserted {1e3 * picture.inserted_length_m:.1f} mm"
        self._texts["figures"].input = f"{inserted}\nrig time {1e-3 * picture.tick:.1f} s\npicture {rate_hz:.0f} Hz"
        self._texts["help"].input = HELP

    def tell_rig(self, state: str, reason: str, *, safe_stop: bool) -> None:
        """Write the state of the rig."""
        shown = "safe_stop" if safe_stop else state
        self._texts["rig"].input = f"{shown.replace('_', ' ').upper()}{'  ' if reason else ''}{reason[:110]}"
        self._styles["rig"].color = _STATES.get(shown, _QUIET)


def _force(newton: float) -> str:
    return f"{1e3 * newton:.1f} mN" if newton < 0.1 else f"{newton:.2f} N"


def _opening(tool: ToolShape, jaw_rad: float) -> str:
    return f"{np.degrees(jaw_rad):5.0f}°" if tool.has_jaws else ""


def _style() -> pv.TextProperty:
    return pv.TextProperty(font_family="courier", color=_QUIET, shadow=False)


def _lens(width: int, height: int) -> vtkPolyDataMapper2D:
    """Return rings round the middle of the window, darker outwards, of which only the covered part is drawn."""
    sides = 96
    angle = 2.0 * np.pi * np.arange(sides) / sides
    around = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    radii, opacities = zip(*_LENS, strict=True)
    centre = np.array([0.5 * width, 0.5 * height, 0.0])
    points = np.concatenate([centre + radius * min(width, height) * around for radius in radii])
    ring, side = np.meshgrid(np.arange(len(_LENS) - 1), np.arange(sides), indexing="ij")
    a, b = ring * sides + side, ring * sides + (side + 1) % sides
    quads = np.stack([np.full_like(a, 4), a, b, b + sides, a + sides], axis=-1)
    mesh = pv.PolyData(points, quads.ravel())
    colours = np.zeros((len(points), 4), np.uint8)
    colours[:, 3] = np.repeat(opacities, sides)
    mesh.point_data.set_scalars(colours, "colours")
    mapper = vtkPolyDataMapper2D()
    mapper.SetInputData(mesh)
    return mapper
