"""The residual compliance between nodes, read as between contact points that lie on them."""

import numpy as np


def between_nodes(residual, nodes):
    """Return R (3 k, 3 k) between ``nodes`` (k,)."""
    corners, weights = np.repeat(nodes[:, None], 3, axis=1), np.tile([1.0, 0.0, 0.0], (len(nodes), 1))
    out = np.empty((3 * len(nodes), 3 * len(nodes)))
    residual.gather_points(corners, weights, out, np.arange(len(nodes), dtype=np.int32))
    return out
