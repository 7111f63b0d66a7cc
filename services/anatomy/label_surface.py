"""The smooth closed surface of a label: blurred, contoured, smoothed, and kept at the label's volume."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy

from trocar.services.anatomy.volume import LabelVolume, Mask
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.surface.mesh import TriangleMesh, triangle_areas_m2, vertex_normals
from trocar.services.meshes.errors import MeshError
from trocar.services.meshes.openings import enclosed_volume_m3

BLUR_VOXELS = 0.65
"""Standard deviation: a single voxel falls to 0.23, below the contour at 0.5, and vanishes with the noise; the middle
of a lumen three voxels wide stays at 0.98."""
PASS_BAND, PASSES = 0.06, 30
"""Of the windowed sinc (Taubin): ripples shorter than some ten edges go. With the blur, 95 % of a duct's surface come
within 0.15 to 0.35 of a voxel of the truth; with a filter twice as strong narrow ducts lose their shape."""
STRAY_SHARE = 0.05
"""Loose pieces with less than this part of the voxels are dropped; a larger one is refused."""
_PAD = 4  # the blur reaches three voxels, as SciPy cuts it at four deviations; one more closes the contour


def clean_mask(volume: LabelVolume, mask: Mask, actions: list[str]) -> Mask:
    """Return the largest piece of a label with its holes filled; what was done is appended to ``actions``.

    Raises MeshError if there are two pieces, or no place is thicker than two voxels.
    """
    pieces, count = scipy.ndimage.label(mask)
    sizes = np.bincount(pieces.ravel())[1:]
    order = np.argsort(-sizes)
    if count > 1:
        place = _place_mm(volume, np.argwhere(pieces == 1 + order[1]).mean(axis=0))
        share = sizes[order[1]] / sizes.sum()
        if share > STRAY_SHARE:
            raise MeshError(
                f"label '{volume.label}' is in {count} pieces, the second with {100 * share:.0f} % of it round {place} "
                "mm: join them, or give them labels of their own"
            )
        actions.append(f"dropped {count - 1} loose pieces of the label, the largest round {place} mm")
    kept = pieces == 1 + order[0]
    filled: Mask = scipy.ndimage.binary_fill_holes(kept)
    if holes := int(filled.sum() - kept.sum()):
        actions.append(f"filled {holes} voxels of holes inside the label")
    if not scipy.ndimage.binary_erosion(filled, border_value=1).any():
        middle = _place_mm(volume, np.argwhere(filled).mean(axis=0))
        raise MeshError(
            f"label '{volume.label}' is nowhere thicker than two voxels, round {middle} mm: resample the scan finer"
        )
    return filled


def label_surface(volume: LabelVolume, mask: Mask) -> TriangleMesh:
    """Return the closed surface of a mask in the patient's axes, in metres.

    Where the mask ends at the border of the volume, the surface is closed there.
    Raises MeshError if its parts touch each other so that it is no closed surface of one piece.
    """
    padded = np.pad(mask, _PAD).astype(np.float32)
    scipy.ndimage.gaussian_filter(padded, BLUR_VOXELS, output=padded)
    mesh = _largest_piece(_contour(padded, volume.spacing_m))
    index = mesh.vertices_m / volume.spacing_m - _PAD
    mesh = TriangleMesh(volume.place_m(index), mesh.triangles)
    if enclosed_volume_m3(mesh) < 0.0:
        mesh = TriangleMesh(mesh.vertices_m, mesh.triangles[:, ::-1])
    return _with_volume(mesh, float(mask.sum() * volume.spacing_m.prod()))


def _contour(values: Any, spacing_m: FloatArray) -> TriangleMesh:
    import pyvista

    grid = pyvista.ImageData(dimensions=values.shape, spacing=spacing_m.tolist())
    grid["label"] = values.ravel(order="F")
    surface = grid.contour([0.5], scalars="label", method="flying_edges").triangulate()
    surface = surface.smooth_taubin(n_iter=PASSES, pass_band=PASS_BAND, normalize_coordinates=True)
    return TriangleMesh(np.asarray(surface.points, dtype=np.float64), np.asarray(surface.regular_faces, np.int32))


def _largest_piece(mesh: TriangleMesh) -> TriangleMesh:
    edges = np.concatenate([mesh.triangles[:, :2], mesh.triangles[:, 1:]])
    n = mesh.n_vertices
    graph = scipy.sparse.coo_array((np.ones(len(edges), np.int8), edges.T), shape=(n, n))
    _, piece = scipy.sparse.csgraph.connected_components(graph, directed=False)
    largest = np.argmax(np.bincount(piece[mesh.triangles[:, 0]]))
    used, triangles = np.unique(mesh.triangles[piece[mesh.triangles[:, 0]] == largest], return_inverse=True)
    return TriangleMesh(mesh.vertices_m[used], triangles.reshape(-1, 3).astype(np.int32))


def _with_volume(mesh: TriangleMesh, volume_m3: float) -> TriangleMesh:
    """Move a closed surface along its normals until it encloses a volume: smoothing has drawn it in."""
    for _ in range(2):
        lack_m3 = volume_m3 - enclosed_volume_m3(mesh)
        mesh = moved_out(mesh, lack_m3 / float(triangle_areas_m2(mesh).sum()))
    return mesh


def moved_out(mesh: TriangleMesh, by_m: float) -> TriangleMesh:
    """Return a surface moved along its normals."""
    return TriangleMesh(mesh.vertices_m + by_m * vertex_normals(mesh), mesh.triangles)


def _place_mm(volume: LabelVolume, index: Any) -> list[float]:
    place: list[float] = np.round(1e3 * volume.place_m(np.atleast_2d(index))[0], 1).tolist()
    return place
