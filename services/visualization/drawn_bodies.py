"""Moving bodies of a picture drawn with pyvista: duct, catheter, tools, and force arrows."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyvista as pv
from scipy.spatial.transform import Rotation
from vtkmodules.util.numpy_support import vtk_to_numpy

from trocar.services.mechanics.arrays import Float32Array, FloatArray, IntArray
from trocar.services.mechanics.scene.wall_bar import WallBar
from trocar.services.visualization import instruments
from trocar.services.visualization.cast_shadow import darkened, hidden
from trocar.services.visualization.picture import PictureLayout, ToolShape
from trocar.services.visualization.scenery import Piece
from trocar.services.visualization.strain import Strain, colours_of_strain
from trocar.services.visualization.thick_wall import ThickWall
from trocar.services.visualization.tissue import DUCT, Bytes, TissueLook, rgb, tissue_colours
from trocar.services.visualization.tube import spline, sweep_tube, tube_triangles

_STEEL, _SLEEVE, _CANNULA = "#b4bbc2", "#2a2e33", "#8ea4b8"
_STONE = "#8a7a3c"
_METAL = {"sleeve": _SLEEVE, "steel": _STEEL}
_CATHETER = "#d8a63c", "#1d1b18", "#2a1f12"
_WIRE = (_STEEL,) * 3  # its shades: as many as `_CATHETER` has
_SIDES, _PER_SEGMENT = 12, 3  # twelve sides differ from a circle by 3 %, 0.03 mm of a catheter, as 1 - cos(pi / 12)
#: Rings of the rounded tip: distance from the last ring, and radius, in radii; the last is in the lumen.
_TIP = np.array([(0.3, 0.97), (0.55, 0.87), (0.72, 0.7), (0.8, 0.5), (0.2, 0.5)], np.float32)
#: Of 1 N, half a jaw's length by eye; it grows with the square root, so that millinewtons are seen beside newtons.
_ARROW_M = 0.022
_HEAD_M = 2e-3  # about as long as a whole arrow of 10 mN
_SEEN = 45  # of 255: least brightness on which shadows are visible
_AMBIENT, _SHARPNESS = 0.12, 40  # of wet tissue under one lamp: judged by eye


class _Surface:
    """A mesh of fixed topology whose points and normals change; colours (n, 3) may."""

    def __init__(self, plotter: pv.Plotter, n_points: int, triangles: IntArray, *, wet: float) -> None:
        faces = np.hstack([np.full((len(triangles), 1), 3, np.int64), triangles]).ravel()
        self.mesh = pv.PolyData(np.zeros((n_points, 3), np.float32), faces)
        self.mesh.point_data["Normals"] = np.zeros((n_points, 3), np.float32)
        self.mesh.GetPointData().SetActiveNormals("Normals")
        self.mesh.point_data["colours"] = np.zeros((n_points, 3), np.uint8)
        self.actor = plotter.add_mesh(
            self.mesh,
            scalars="colours",
            rgb=True,
            smooth_shading=False,
            specular=wet,
            specular_power=_SHARPNESS,
            ambient=_AMBIENT,
        )
        self.actor.prop.interpolation = "Phong"
        self._vtk_points = self.mesh.GetPoints().GetData()
        self._vtk_normals = self.mesh.GetPointData().GetNormals()
        self.points: Float32Array = vtk_to_numpy(self._vtk_points)
        self.normals: Float32Array = vtk_to_numpy(self._vtk_normals)
        self._vtk_colours = self.mesh.GetPointData().GetArray("colours")
        self._colours: Bytes = vtk_to_numpy(self._vtk_colours)

    def colour(self, colours: Bytes) -> None:
        """Set a colour for each point."""
        self._colours[:] = colours
        self._vtk_colours.Modified()

    def changed(self) -> None:
        """Notify VTK of new points and normals."""
        for part in (self._vtk_points, self._vtk_normals, self.mesh.GetPoints(), self.mesh):
            part.Modified()


class DrawnPiece:
    """A piece of scenery with shadows, lit at its vertices because the bed has most of the pixels.

    Diffuse and specular light of the lamp at the lens, with white (0 to 1), are computed as VTK does per pixel, which
    took a fifth of a picture's time.
    """

    def __init__(self, plotter: pv.Plotter, piece: Piece) -> None:
        self._piece = piece
        self._surface = _Surface(plotter, len(piece.points_m), piece.triangles, wet=0.0)
        self.actor = self._surface.actor
        self.actor.prop.lighting, self.actor.prop.ambient = False, 0.0  # VTK would add ambient light to unlit actors
        self._surface.points[:], self._surface.normals[:] = piece.points_m, piece.normals
        self._surface.changed()
        lit = piece.colours.max(axis=1) > _SEEN
        self._near = np.flatnonzero(lit)
        self._share = np.zeros(len(piece.points_m), np.float32)
        self._normals = piece.normals / np.maximum(np.linalg.norm(piece.normals, axis=1, keepdims=True), 1e-12)
        self._lens: tuple[float, ...] = ()
        self._lit = piece.colours

    def shade(self, *rods: Float32Array) -> None:
        """Set the shadows of rods: starts and ends (k, 3), radii (k,)."""
        self._share[self._near] = hidden(self._piece.points_m[self._near], *rods)
        self._surface.colour(darkened(self._lit, self._share))

    def light(self, camera: pv.Camera, white: FloatArray) -> None:
        """Update the lighting if the lens has turned."""
        lens = camera.direction
        if lens != self._lens:
            self._lens = lens
            facing = np.maximum(self._normals @ -np.array(lens), 0.0)[:, None]
            shine = 255.0 * _shine(self._piece.look) * facing**_SHARPNESS
            lit = self._piece.colours * (_AMBIENT + facing * white) + shine * white
            self._lit = np.minimum(lit, 255.0).astype(np.uint8)
            self._surface.colour(darkened(self._lit, self._share))


def _shine(look: TissueLook) -> float:
    return 0.85 * max(0.0, look.wet - 0.15)


class DrawnDuct:
    """The duct's wall."""

    def __init__(self, plotter: pv.Plotter, layout: PictureLayout, *, fine: bool) -> None:
        self._wall = ThickWall(layout.rest_m, layout.triangles, layout.thickness_m, fine=fine)
        self._surface = _Surface(plotter, self._wall.n_points, self._wall.triangles, wet=_shine(DUCT))
        self.actor = self._surface.actor
        self._strain = Strain(layout.rest_m, layout.triangles)
        self._wall.update(layout.rest_m, self._surface.points, self._surface.normals)
        self._flesh = tissue_colours(self._surface.points, DUCT)
        self._share = np.zeros(len(self._flesh), np.float32)

    def update(self, points_m: Float32Array, *rods: Float32Array, strained: bool) -> None:
        """Update to the mid-surface (n, 3), with shadows of rods, coloured by strain or as flesh."""
        self._wall.update(points_m, self._surface.points, self._surface.normals)
        self._surface.changed()
        outside = self._wall.n_middle
        self._share[:outside] = hidden(self._surface.points[:outside], *rods)
        colours = self._flesh
        if strained:
            colours = colours_of_strain(self._wall.of_nodes(self._strain.at(points_m)))
        self._surface.colour(darkened(colours, self._share))

    def outer_face_m(self) -> Float32Array:
        """Return the corners (m, 3, 3) of the triangles of the outer face."""
        return self._surface.points[self._wall.outer]


class DrawnRod:
    """The catheter, with a ring every centimetre from its tip for reading the depth, or its wire."""

    def __init__(self, plotter: pv.Plotter, n_particles: int, radius_m: float, colours: tuple[str, str, str]) -> None:
        self._radius_m, self._marking = radius_m, colours
        self._along = (n_particles - 1) * _PER_SEGMENT + 1
        rings = self._along + len(_TIP)
        self._radii_m = np.full(rings, self._radius_m, np.float32)
        self._radii_m[self._along :] *= _TIP[:, 1]
        triangles = tube_triangles(rings, _SIDES)
        self._surface = _Surface(plotter, rings * _SIDES, triangles, wet=0.5)
        self._marked = False

    def update(self, centreline_m: Float32Array) -> None:
        """Update to the particles (m, 3), tip last."""
        curve = spline(centreline_m, _PER_SEGMENT)
        ahead = curve[-1] - curve[-2]
        ahead /= max(float(np.linalg.norm(ahead)), 1e-9)
        tip = curve[-1] + self._radius_m * _TIP[:, :1] * ahead
        line = np.concatenate([curve, tip]).astype(np.float32)
        sweep_tube(line, self._radii_m, self._surface.points, self._surface.normals)
        self._surface.changed()
        if not self._marked and np.ptp(centreline_m) > 0.0:
            self._surface.colour(self._marks(curve))
            self._marked = True

    def _marks(self, curve: Float32Array) -> Bytes:
        steps_mm = 1e3 * np.linalg.norm(np.diff(curve[::-1], axis=0), axis=1)
        from_tip_mm = np.concatenate([np.zeros(len(_TIP)), [0.0], np.cumsum(steps_mm)])[::-1]
        marked = (from_tip_mm > 5.0) & (np.abs(from_tip_mm - 10.0 * np.round(from_tip_mm / 10.0)) < 0.55)
        body, mark, bore = map(rgb, self._marking)
        colours = np.where(marked[:, None], mark, body)
        colours[-1] = bore
        return np.repeat(colours, _SIDES, axis=0).astype(np.uint8)


class DrawnCatheter:
    """Catheter and wire."""

    def __init__(self, plotter: pv.Plotter, layout: PictureLayout) -> None:
        every = range(layout.n_particles)
        self.rods = [
            (part, DrawnRod(plotter, len(every[part]), radius_m, colours))
            for (part, radius_m), colours in zip(layout.rods(), (_CATHETER, _WIRE), strict=False)
        ]

    def update(self, centreline_m: Float32Array) -> None:
        """Update to the particles (m, 3), tip last."""
        for part, rod in self.rods:
            rod.update(centreline_m[part])


class DrawnBar:
    """A bar on the wall, such as a leg of a clip."""

    def __init__(self, plotter: pv.Plotter, bar: WallBar, thickness_m: float) -> None:
        length_m, width_m, high_m = bar.size_m
        self._bar, self._above_m = bar, 0.5 * (thickness_m + high_m)
        self._actor = _solid(plotter, pv.Cube(x_length=length_m, y_length=high_m, z_length=width_m), _STEEL)
        along, outward = np.array(bar.along), np.array(bar.outward)
        self._frame = np.eye(4)
        self._frame[:3, :3] = np.column_stack([along, outward, np.cross(along, outward)])

    def update(self, points_m: Float32Array) -> None:
        """Move to where the wall's nodes (n, 3) are."""
        under_m = np.array(self._bar.weights) @ points_m[list(self._bar.nodes)]
        self._frame[:3, 3] = under_m + self._above_m * np.array(self._bar.outward)
        self._actor.user_matrix = self._frame.copy()


class DrawnStone:
    """A stone in the duct."""

    def __init__(self, plotter: pv.Plotter, radius_m: float) -> None:
        self._actor = _solid(plotter, pv.Icosphere(radius=radius_m, nsub=3), _STONE)

    def update(self, place_m: Float32Array) -> None:
        """Move to where its middle (3,) is."""
        frame = np.eye(4)
        frame[:3, 3] = place_m
        self._actor.user_matrix = frame


class Tool:
    """One tool: round parts, and two jaws if it has any, moved as rigid bodies, in the tube of its port."""

    def __init__(self, plotter: pv.Plotter, shape: ToolShape) -> None:
        self._port_m = shape.port_m
        self._shaft = [_solid(plotter, instruments.round_part(part), _METAL[part.material]) for part in shape.parts]
        self._jaws = [_solid(plotter, instruments.jaw(shape), _STEEL) for _ in range(2 * shape.has_jaws)]
        self._cannula = _solid(plotter, instruments.cannula(shape), _CANNULA)

    def place(self, pose: Float32Array, opening_rad: float) -> None:
        """Move to a pose (7,), with the jaws, if there are any, `opening_rad` apart."""
        transform = pose_matrix(pose)
        for actor in self._shaft:
            actor.user_matrix = transform
        if self._jaws:
            jaw_a, jaw_b = self._jaws
            jaw_a.user_matrix = transform @ _rotation("z", 0.5 * opening_rad)
            jaw_b.user_matrix = transform @ _rotation("z", -0.5 * opening_rad) @ _rotation("x", np.pi)
        at_port = transform.copy()
        at_port[:3, 3] = self._port_m
        self._cannula.user_matrix = at_port


class ForceArrow:
    """The force of the tissue on a tool."""

    def __init__(self, plotter: pv.Plotter) -> None:
        self._parts = [_solid(plotter, mesh, "#7ad7c4") for mesh in instruments.arrow()]
        for part in self._parts:
            part.prop.lighting = False

    def place(self, start_m: Float32Array, force_n: Float32Array, *, shown: bool) -> None:
        """Draw a force (3,) from a point (3,)."""
        size_n = float(np.linalg.norm(force_n))
        length_m = _ARROW_M * np.sqrt(size_n)
        visible = bool(shown and length_m > 6e-4)
        for part in self._parts:
            part.visibility = visible
        if not visible:
            return
        frame = np.eye(4)
        frame[:3, :3] = Rotation.align_vectors([force_n / size_n], [[1.0, 0.0, 0.0]])[0].as_matrix()
        frame[:3, 3] = start_m
        stem, head = self._parts
        stem.user_matrix = frame @ np.diag([max(1e-5, length_m - _HEAD_M), 1.0, 1.0, 1.0])
        ahead = np.eye(4)
        ahead[0, 3] = max(0.0, length_m - _HEAD_M)
        head.user_matrix = frame @ ahead
        for part in self._parts:
            part.prop.color = colour_of_force(size_n)


def colour_of_force(size_n: float) -> str:
    """Return green below 1 N, amber below 2 N, red from there on, as the page does."""
    return "#67d1bd" if size_n < 1.0 else "#eab54d" if size_n < 2.0 else "#f0695a"


def pose_matrix(pose: Float32Array) -> FloatArray:
    """Return the homogeneous transform (4, 4) of a position and quaternion wxyz."""
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_quat(pose[3:], scalar_first=True).as_matrix()
    matrix[:3, 3] = pose[:3]
    return matrix


def _rotation(axis: str, angle_rad: float) -> FloatArray:
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_euler(axis, angle_rad).as_matrix()
    return matrix


def _solid(plotter: pv.Plotter, mesh: pv.PolyData, colour: str) -> Any:
    actor = plotter.add_mesh(
        mesh, color=colour, smooth_shading=False, specular=0.8, specular_power=30, ambient=_AMBIENT
    )
    actor.prop.interpolation = "Phong"
    return actor
