"""The picture drawn on this host with pyvista: in a window, or off the screen for snapshots, video and MJPEG.

Software rendering is fast enough only without what costs it most: no multisampling, one headlight, no mipmaps. The
duct's points and normals are written in place into the arrays that VTK draws from.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pyvista as pv
from scipy.spatial.transform import Rotation
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkUnsignedCharArray

from services.mechanics.arrays import Float32Array, FloatArray, IntArray
from services.visualization.normals import vertex_normals
from services.visualization.picture import Layout, Picture, ToolShape
from services.visualization.tube import sweep_tube, tube_triangles

_SIDES = 12
_HARDWARE_SAMPLES = 4
_SOFTWARE = ("llvmpipe", "softpipe", "swrast", "software")
_SHAFT_LENGTH_M = 0.25
_TISSUE, _CATHETER, _STEEL, _SLEEVE, _NIGHT = "#c4675c", "#d8a63c", "#b4bbc2", "#2a2e33", "#160a08"


class _Surface:
    """A mesh of fixed topology whose points and normals change."""

    def __init__(self, plotter: pv.Plotter, points: Float32Array, triangles: IntArray, colour: str) -> None:
        faces = np.hstack([np.full((len(triangles), 1), 3, np.int64), triangles]).ravel()
        self.mesh = pv.PolyData(np.ascontiguousarray(points, np.float32), faces)
        self.mesh.point_data["Normals"] = np.zeros_like(points, np.float32)
        self.mesh.GetPointData().SetActiveNormals("Normals")
        actor = plotter.add_mesh(self.mesh, color=colour, smooth_shading=False, specular=0.6, specular_power=40)
        actor.prop.SetInterpolationToPhong()
        self._vtk_points = self.mesh.GetPoints().GetData()
        self._vtk_normals = self.mesh.GetPointData().GetNormals()
        self.points: Float32Array = vtk_to_numpy(self._vtk_points)
        self.normals: Float32Array = vtk_to_numpy(self._vtk_normals)

    def changed(self) -> None:
        """Tell VTK that points and normals are new."""
        for part in (self._vtk_points, self._vtk_normals, self.mesh.GetPoints(), self.mesh):
            part.Modified()


class Renderer:
    """A pyvista scene that follows layouts and pictures. One thread makes it and draws with it: contexts demand that.

    Parameters
    ----------
    off_screen
        Draw without a window.
    size
        Width and height in pixels.
    """

    def __init__(self, *, off_screen: bool, size: tuple[int, int] = (800, 600)) -> None:
        self.plotter = pv.Plotter(off_screen=off_screen, window_size=list(size), lighting="none", title="Trocar")
        self.plotter.set_background(_NIGHT, top="#2a1512")
        self.plotter.add_light(pv.Light(light_type="headlight"))
        self.plotter.render_window.SetMultiSamples(0)
        self._epoch = -1
        self._layout: Layout | None = None
        self._pixels = vtkUnsignedCharArray()

    def update(self, layout: Layout, picture: Picture) -> None:
        """Put `picture` on the stage; draws nothing yet."""
        if layout.epoch != self._epoch:
            self._build(layout)
        self._duct.points[:] = picture.points_m
        vertex_normals(picture.points_m, layout.triangles, self._duct.normals)
        self._duct.changed()
        if self._tube is not None:
            sweep_tube(picture.centreline_m, layout.catheter_radius_m, self._tube.points, self._tube.normals)
            self._tube.changed()
        for tool, pose, jaw in zip(self._tools, picture.poses, picture.jaw_rad, strict=True):
            tool.place(pose, float(jaw))

    def draw(self) -> None:
        """Draw."""
        self.plotter.render_window.Render()

    def smooth_edges(self) -> None:
        """Take four samples a pixel where a graphics processor draws; in software they cost four times the time."""
        capabilities = self.plotter.render_window.ReportCapabilities().lower()
        if not any(name in capabilities for name in _SOFTWARE):
            self.plotter.render_window.SetMultiSamples(_HARDWARE_SAMPLES)

    def image(self) -> npt.NDArray[np.uint8]:
        """Draw and return the picture (height, width, 3)."""
        self.draw()
        window = self.plotter.render_window
        width, height = window.GetSize()
        window.GetPixelData(0, 0, width - 1, height - 1, 0, self._pixels, 0)
        return np.flipud(vtk_to_numpy(self._pixels).reshape(height, width, 3))

    def close(self) -> None:
        """Give up window and context."""
        self.plotter.close()

    def _build(self, layout: Layout) -> None:
        first = self._layout is None
        self.plotter.clear_actors()
        self._layout, self._epoch = layout, layout.epoch
        self._duct = _Surface(self.plotter, layout.rest_m, layout.triangles, _TISSUE)
        self._tube: _Surface | None = None
        if layout.n_particles > 1:
            points = np.zeros((layout.n_particles * _SIDES, 3), np.float32)
            self._tube = _Surface(self.plotter, points, tube_triangles(layout.n_particles, _SIDES), _CATHETER)
        self._tools = [_Tool(self.plotter, shape) for shape in layout.tools]
        if first:
            self._look_at(layout.rest_m)

    def _look_at(self, points: Float32Array) -> None:
        """Take the laparoscope's place: from beside and above, towards the mouth's half of the duct."""
        low, high = points.min(axis=0), points.max(axis=0)
        size = float(np.linalg.norm(high - low))
        focus = 0.5 * (low + high) + np.array([0.15 * size, 0.0, 0.0])
        camera = self.plotter.camera
        camera.focal_point = tuple(focus)
        camera.position = tuple(focus + size * np.array([0.85, -0.95, 0.95]))
        camera.up = (0.0, 0.0, 1.0)
        camera.view_angle = 50.0
        camera.clipping_range = (0.05 * size, 20.0 * size)


class _Tool:
    """One forceps: a sleeve, a collar and two jaws, moved as rigid bodies."""

    def __init__(self, plotter: pv.Plotter, shape: ToolShape) -> None:
        radius, jaw = shape.shaft_radius_m, shape.jaw_radius_m
        sleeve = _rod(-_SHAFT_LENGTH_M, -8e-3, radius)
        collar = _rod(-8e-3, 0.0, 0.75 * radius)
        blade = pv.Capsule(
            center=(0.5 * shape.jaw_length_m, 0.0, 0.0), direction=(1.0, 0.0, 0.0), radius=jaw,
            cylinder_length=max(shape.jaw_length_m - 2.0 * jaw, jaw), resolution=20,
        )  # fmt: skip
        self._shaft = [_solid(plotter, sleeve, _SLEEVE), _solid(plotter, collar, _STEEL)]
        self._jaws = [_solid(plotter, blade.copy(), _STEEL) for _ in range(2)]

    def place(self, pose: Float32Array, opening_rad: float) -> None:
        """Move to a pose (7,) with the jaws `opening_rad` apart."""
        transform = pose_matrix(pose)
        for actor in self._shaft:
            actor.user_matrix = transform
        for actor, sign in zip(self._jaws, (0.5, -0.5), strict=True):
            actor.user_matrix = transform @ _turn_about_z(sign * opening_rad)


def pose_matrix(pose: Float32Array) -> FloatArray:
    """Return the homogeneous transform (4, 4) of a position and quaternion wxyz."""
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_quat(pose[3:], scalar_first=True).as_matrix()
    matrix[:3, 3] = pose[:3]
    return matrix


def _turn_about_z(angle_rad: float) -> FloatArray:
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_euler("z", angle_rad).as_matrix()
    return matrix


def _rod(start_m: float, end_m: float, radius_m: float) -> pv.PolyData:
    return pv.Cylinder(
        center=(0.5 * (start_m + end_m), 0.0, 0.0), direction=(1.0, 0.0, 0.0), radius=radius_m,
        height=end_m - start_m, resolution=24,
    )  # fmt: skip


def _solid(plotter: pv.Plotter, mesh: pv.PolyData, colour: str) -> Any:
    return plotter.add_mesh(
        mesh, color=colour, smooth_shading=True, split_sharp_edges=True, specular=0.8, specular_power=30
    )
