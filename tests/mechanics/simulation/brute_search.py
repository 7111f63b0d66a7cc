"""Contact search by trying every triangle: slow, short, and independent of `services.mechanics.collision`."""

import numpy as np
from numba import njit

from services.mechanics.collision.pairs import CATHETER_SEGMENT, DUCT_TRIANGLE, NO_TOOL
from services.mechanics.collision.primitives import closest_of_segments, closest_segment_triangle


class BruteSearch:
    def __init__(self, scene, duct):
        self.mesh = duct.mesh
        self.reach_m = scene.contact.margin_m
        self.half_m = 0.5 * scene.duct.thickness_m
        self.radius_m = 0.5 * scene.catheter.outer_diameter_m

    @property
    def inside(self):
        return np.zeros(1000, np.int8)

    def start(self, duct):
        every = np.arange(self.mesh.n_vertices, dtype=np.int32)
        u = duct.reduced.basis.displacements(duct.q_start)
        n = duct.n_loads
        duct.reduced.residual.apply(duct.load_nodes[:n], duct.load_force_n[:n], every, u)
        self.x = self.mesh.vertices_m + u

    def node_positions(self, nodes, out):
        out[:] = self.x[nodes]

    def catheter_pairs(self, catheter, pairs):
        x = self.x
        for i, p in enumerate(catheter.start_m):
            d, t, _, w = nearest(x, self.mesh.triangles, p, p)
            gap = d - self.radius_m - self.half_m
            if gap < self.reach_m and d > 0.0:
                target = sum(w[k] * x[self.mesh.triangles[t, k]] for k in range(3))
                self.add(pairs, (NO_TOOL, 0, i), (DUCT_TRIANGLE, t, w), 0.0, (p - target) / d, gap)

    def sphere_detector(self, radius_m):
        raise NotImplementedError

    def tool_pairs(self, catheter, tools, pairs):
        x = self.x
        for tool in range(2):
            if not tools.present[tool]:
                continue
            for segment in range(3):
                a, b = tools.segments[tool, segment]
                radius = tools.radius_m[tool, segment]
                d, t, s, w = nearest(x, self.mesh.triangles, a, b)
                gap = d - radius - self.half_m
                if d > 0.0 and gap < self.reach_m:
                    target = sum(w[k] * x[self.mesh.triangles[t, k]] for k in range(3))
                    n = ((1 - s) * a + s * b - target) / d
                    self.add(pairs, (tool, segment, -1), (DUCT_TRIANGLE, t, w), s, n, gap)
                c = catheter.start_m
                for j in range(len(c) - 1):
                    s, r, d2 = closest_of_segments(tuple(a), tuple(b), tuple(c[j]), tuple(c[j + 1]))
                    d = np.sqrt(d2)
                    gap = d - radius - self.radius_m
                    if d > 0.0 and gap < self.reach_m:
                        n = ((1 - s) * a + s * b - (1 - r) * c[j] - r * c[j + 1]) / d
                        self.add(pairs, (tool, segment, -1), (CATHETER_SEGMENT, j, (1 - r, r, 0.0)), s, n, gap)

    @staticmethod
    def add(pairs, first, target, s, normal, gap):
        k = pairs.count
        if k == pairs.capacity:
            pairs.dropped += 1
            return
        pairs.tool[k], pairs.tool_segment[k], pairs.particle[k] = first
        pairs.target_kind[k], pairs.target[k] = target[0], target[1]
        pairs.target_weights[k] = target[2]
        pairs.tool_parameter[k] = s
        pairs.normal[k] = normal
        pairs.gap_m[k] = gap
        pairs.count += 1


@njit
def nearest(x, triangles, a, b):
    best = (1e30, 0, 0.0, (1.0, 0.0, 0.0))
    p, q = (a[0], a[1], a[2]), (b[0], b[1], b[2])
    for t in range(len(triangles)):
        i, j, k = triangles[t]
        d2, s, w = closest_segment_triangle(
            p, q, (x[i, 0], x[i, 1], x[i, 2]), (x[j, 0], x[j, 1], x[j, 2]), (x[k, 0], x[k, 1], x[k, 2])
        )
        if d2 < best[0]:
            best = (d2, t, s, w)
    return (np.sqrt(best[0]), best[1], best[2], best[3])
