"""Through the junction of a real vessel: in at one end, out at each of the others, the wall breathing all the while."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from collision_cases import CATHETER_M, HALF_M, MARGIN_M, N_MODES, deformed, random_coordinates, wavy_surface
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from services.mechanics.collision import CatheterContactDetector
from services.mechanics.collision.pairs import ContactPairs
from services.mechanics.collision.topology import fill_rim

ANATOMY = Path(__file__).parents[3].parent / "shared" / "data" / "anatomy" / "aorta-surface-open-ends.stl"
GRID_M, STEP_M = 1.4e-3, 0.15e-3


@pytest.fixture(scope="module")
def vessel():
    if not ANATOMY.exists():
        pytest.skip(f"needs the scan {ANATOMY.name}, which is not part of the repository")
    meshes = pytest.importorskip("services.meshes", reason="needs the mesh packages")
    settings = meshes.SurfaceSettings(units="mm", lumen_diameter_m=9e-3, edge_m=1.3e-3)
    mesh = meshes.load_duct_surface(ANATOMY, settings).mesh
    assert 1500 <= mesh.n_triangles <= 6000
    surface = wavy_surface(mesh, np.random.default_rng(8))
    surface.update(np.zeros(N_MODES))
    return surface


def lumen_grid(surface):
    """Points of a grid 1.25 mm deep in the lumen, and the graph of neighbours among them."""
    low, high = surface.mesh.vertices_m.min(0), surface.mesh.vertices_m.max(0)
    axes = [np.arange(a, b, GRID_M) for a, b in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    detector = CatheterContactDetector(surface, len(points), 0.9e-3, 0.1e-3)
    pairs = ContactPairs.allocate(2 * len(points))
    detector.detect(points, pairs)
    free = detector.inside.astype(bool)
    free[pairs.particle[: pairs.count]] = False
    points = points[free]
    distance = np.linalg.norm(points[:, None] - points[None], axis=2)
    i, j = np.nonzero((distance > 0.0) & (distance < 1.8 * GRID_M))
    return points, coo_array((distance[i, j], (i, j)), shape=(len(points),) * 2).tocsr()


def route(points, graph, start, end):
    nearest = [int(np.argmin(np.linalg.norm(points - p, axis=1))) for p in (start, end)]
    lengths, before = dijkstra(graph, indices=nearest[0], return_predecessors=True)
    assert np.isfinite(lengths[nearest[1]]), "the grid does not connect the ends"
    way = [nearest[1]]
    while way[-1] != nearest[0]:
        way.append(int(before[way[-1]]))
    return [start, *points[way[::-1]], end]


def winding_number(p, vertices, triangles):
    """Solid angle of a closed surface over 4 pi (van Oosterom and Strackee, 1983): one inside, zero outside."""
    a, b, c = (vertices[triangles[:, k]] - p for k in range(3))
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    numerator = (a * np.cross(b, c)).sum(1)
    denominator = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
    return np.arctan2(numerator, denominator).sum() / (2.0 * np.pi)


def end_points(surface, rim):
    """A point 3 mm outside the middle of an open end."""
    corners = surface.mesh.vertices_m[fill_rim(surface.mesh.vertices_m, rim)]
    out = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).sum(0)
    return surface.mesh.vertices_m[rim].mean(0) + 3e-3 * out / np.linalg.norm(out)


def test_from_one_end_to_the_others(vessel):
    rng = np.random.default_rng(3)
    points, graph = lumen_grid(vessel)
    caps = np.concatenate([fill_rim(vessel.mesh.vertices_m, rim) for rim in vessel.rims])
    closed = np.concatenate([vessel.mesh.triangles, caps])
    ends = [end_points(vessel, rim) for rim in vessel.rims]
    assert len(ends) == 3
    shape, touched = random_coordinates(rng, 0.4e-3), 0
    for goal in (1, 2):
        detector, tick = CatheterContactDetector(vessel, 1, CATHETER_M, MARGIN_M), 0
        vessel.update(0.0 * shape)
        x = ends[0].copy()
        for start, end in pairwise(route(points, graph, ends[0], ends[goal])):
            for part in np.linspace(0.0, 1.0, int(np.linalg.norm(end - start) / STEP_M) + 2)[1:]:
                tick += 1
                vessel.update(np.sin(0.05 * tick) * shape)
                # Swing from wall to wall on the way, less in a tick than a touching particle is off the wall.
                swing = (
                    4e-3
                    * np.sin(np.array([0.11, 0.13, 0.17]) * tick)
                    * (winding_number(x, deformed(vessel), closed) > 0.5)
                )
                move = start + part * (end - start) + swing - x
                x = x + move * min(1.0, 0.7e-3 / np.linalg.norm(move))
                touched += keep_out(detector, x)
                winding = winding_number(x, deformed(vessel), closed)
                assert winding == pytest.approx(round(winding), abs=1e-6)
                assert detector.inside[0] == round(winding)
        assert detector.inside[0] == 0, "out at the other end"
    assert touched > 20


def keep_out(detector, x):
    """Push x out of the wall by its contacts, a few times; return whether it touched."""
    touched = False
    for _ in range(4):
        pairs = ContactPairs.allocate(4)
        detector.detect(x[None], pairs)
        for k in range(pairs.count):
            assert pairs.gap_m[k] > -CATHETER_M - HALF_M, "found on the wrong side of the wall"
            touched = touched or pairs.gap_m[k] < 0.0
            x -= min(pairs.gap_m[k], 0.0) * pairs.normal[k]
    return touched
