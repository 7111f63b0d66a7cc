"""All nodes of a tube with large rotations."""

import numpy as np

from trocar.services.mechanics.reduction.large_rotations.warping import SectionFrame


def warped_positions(warp, q, extra_m=None):
    """Return the position of every node (n, 3) in m; ``extra_m`` (n, 3) adds displacement in turned frames."""
    frame, out = SectionFrame(warp), np.empty_like(warp.arm_m)
    frame.update(q)
    extra = np.zeros_like(out) if extra_m is None else extra_m
    frame.node_positions(np.arange(len(out), dtype=np.int32), extra, out)
    return out
