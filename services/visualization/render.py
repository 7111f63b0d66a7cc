"""Rendering on this host with pyvista: in a window, or off the screen for snapshots, video and MJPEG.

Software rendering is only fast enough without the most expensive features: no multisampling, one light at the lens, no
mipmaps, no sorting of transparent surfaces (a third of a picture, for a ring), no inner faces of closed surfaces.
Points and normals of moving bodies are written in place into VTK's arrays.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pyvista as pv
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkUnsignedCharArray
from vtkmodules.vtkCommonTransforms import vtkTransform

from trocar.services.runtime.errors import UserError
from trocar.services.start.graphics_libraries import CannotDrawError, check_graphics_libraries
from trocar.services.visualization import cameras
from trocar.services.visualization.cast_shadow import Rods
from trocar.services.visualization.drawn_bodies import (
    DrawnBar,
    DrawnCatheter,
    DrawnDuct,
    DrawnPiece,
    DrawnStone,
    ForceArrow,
    Tool,
    pose_matrix,
)
from trocar.services.visualization.meeting_ring import MeetingRing
from trocar.services.visualization.picture import Picture, PictureLayout
from trocar.services.visualization.scenery import scenery

_SOFTWARE = ("llvmpipe", "softpipe", "swrast", "software")
_NIGHT = "#0a0505"


@dataclass(frozen=True, slots=True)
class Effects:
    """Quality of the picture: samples a pixel, finer surfaces."""

    samples: int = 0
    fine: bool = True


class Renderer:
    """A pyvista scene that follows layouts and pictures; the same thread must create it and draw.

    Raises UserError: the system lacks a library that drawing needs.

    Args:
        off_screen: Draw without a window.
        size: Width and height in pixels.
        effects: Initial quality.
    """

    def __init__(self, *, off_screen: bool, size: tuple[int, int] = (800, 600), effects: Effects | None = None) -> None:
        try:
            check_graphics_libraries()
        except CannotDrawError as error:
            raise UserError(str(error)) from None
        self.plotter = pv.Plotter(off_screen=off_screen, window_size=list(size), lighting="none", title="Trocar")
        self.plotter.set_background(_NIGHT)
        self.plotter.renderer.SetUseOIT(False)
        self._lamp = pv.Light(light_type="headlight", color="#fff4e6")
        self.plotter.add_light(self._lamp)
        self.show_forces = self.show_aim = True
        self.show_strain = False
        self._mirrored = False
        self.effects = effects or Effects()
        self.plotter.render_window.SetMultiSamples(self.effects.samples)
        self._scenery: list[DrawnPiece] = []
        self._actors: list[pv.Actor] = []  # of the scene, which lies under what a window writes over it
        self._layout: PictureLayout | None = None
        self._built: PictureLayout | None = None
        self._picture: Picture | None = None
        self._pixels = vtkUnsignedCharArray()

    def update(self, layout: PictureLayout, picture: Picture) -> None:
        """Update the scene to `picture`, without drawing."""
        first, self._layout, self._picture = self._layout is None, layout, picture
        if layout is not self._built:
            self._build(layout)
        if first:
            self.look_from("scope")
        instruments, duct = self._rods.instruments(picture), self._rods.duct(picture)
        self._duct.update(picture.points_m, *instruments, strained=self.show_strain)
        for piece in self._scenery:
            piece.shade(*(np.concatenate(both) for both in zip(instruments, duct, strict=True)))
        if self._catheter is not None:
            self._catheter.update(picture.centreline_m)
        for bar in self._bars:
            bar.update(picture.points_m)
        for stone, place_m in zip(self._stones, picture.stones_m, strict=False):
            stone.update(place_m)
        face_m = self._duct.outer_face_m()
        for i, (tool, arrow, ring) in enumerate(zip(self._tools, self._arrows, self._rings, strict=True)):
            pose = picture.poses[i]
            tool.place(pose, float(picture.jaw_rad[i]))
            arrow.place(pose[:3], picture.force_n[i], shown=self.show_forces)
            ring.place(face_m, pose, pose_matrix(pose)[:3, 0], shown=self.show_aim)

    def take_effects(self, effects: Effects) -> None:
        """Change the effects."""
        self.plotter.render_window.SetMultiSamples(effects.samples)
        self.effects, self._built = effects, None
        if self._layout is not None and self._picture is not None:
            self.update(self._layout, self._picture)

    def look_from(self, preset: str) -> None:
        """Move the lens to one of `cameras.PRESETS`; does nothing before the first layout."""
        if self._layout is None:
            return
        place = cameras.place(self._layout, preset)
        camera = self.plotter.camera
        camera.focal_point, camera.position, camera.up = tuple(place.aim_m), tuple(place.position_m), (0.0, 0.0, 1.0)
        camera.view_angle = cameras.VIEW_ANGLE_DEG
        camera.clipping_range = (0.02 * place.size_m, 20.0 * place.size_m)

    def mirror(self) -> None:
        """Toggle mirroring of the picture, as for a scope seen from the other side."""
        self._mirrored = not self._mirrored
        transform = vtkTransform()
        transform.Scale(-1.0 if self._mirrored else 1.0, 1.0, 1.0)
        self.plotter.camera.SetUserTransform(transform)
        self._face()

    def draw(self) -> None:
        """Draw."""
        for piece in self._scenery:
            piece.light(self.plotter.camera, np.array(self._lamp.diffuse_color.float_rgb))
        self.plotter.render_window.Render()

    def is_software(self) -> bool:
        """Return whether rendering is in software, where every pixel counts; call this after drawing."""
        capabilities = self.plotter.render_window.ReportCapabilities().lower()
        return any(name in capabilities for name in _SOFTWARE)

    def image(self) -> npt.NDArray[np.uint8]:
        """Draw and return the picture (height, width, 3)."""
        self.draw()
        window = self.plotter.render_window
        width, height = window.GetSize()
        window.GetPixelData(0, 0, width - 1, height - 1, 0, self._pixels, 0)
        return np.flipud(vtk_to_numpy(self._pixels).reshape(height, width, 3))

    def close(self) -> None:
        """Close window and context."""
        self.plotter.close()

    def _build(self, layout: PictureLayout) -> None:
        effects, plotter = self.effects, self.plotter
        plotter.remove_actor(self._actors, reset_camera=False, render=False)
        others = set(plotter.actors)
        self._built = layout
        self._rods = Rods(layout)
        self._duct = DrawnDuct(plotter, layout, fine=effects.fine)
        self._catheter = DrawnCatheter(plotter, layout) if layout.n_particles > 1 else None
        self._bars = [DrawnBar(plotter, bar, layout.thickness_m) for bar in layout.bars]
        self._stones = [DrawnStone(plotter, radius_m) for radius_m in layout.stone_radii_m]
        self._tools = [Tool(plotter, shape) for shape in layout.tools]
        self._arrows = [ForceArrow(plotter) for _ in layout.tools]
        self._scenery = [DrawnPiece(plotter, piece) for piece in scenery(layout, cells=90 if effects.fine else 45)]
        self._rings = [MeetingRing(plotter, shape) for shape in layout.tools]
        self._actors = [actor for name, actor in plotter.actors.items() if name not in others]
        self._face()

    def _face(self) -> None:
        """Set culling and lighting of faces for the present mirroring.

        A mirrored triangle has the opposite orientation, and VTK would take its front for its back and leave it dark.
        """
        for actor in self._actors:
            shader = actor.GetShaderProperty()
            shader.ClearAllFragmentShaderReplacements()
            if self._mirrored:
                shader.AddFragmentShaderReplacement("gl_FrontFacing == false", False, "gl_FrontFacing == true", True)
        for closed in (self._duct.actor, *(piece.actor for piece in self._scenery)):
            closed.prop.culling = "front" if self._mirrored else "back"
