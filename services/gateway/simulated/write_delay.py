"""A simulated device whose forces come late: what its motors give while written forces are still under way.

Forces come in the order in which they were written; one that is overtaken never acts.
"""

from __future__ import annotations

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel

#: Rows of an array of forces under way, the newest first: a force or torques, and the time until it acts, s. The last
#: row acts until another does.
WRITES, WRITE_SIZE, WRITE_WAIT = 6, 4, 3


@kernel
def write_late(writes: FloatArray, x: float, y: float, z: float, wait_s: float) -> None:
    """Put a force under way, which acts in `wait_s` >= 0; `writes` is (WRITES, WRITE_SIZE)."""
    for row in range(WRITES - 1, 0, -1):
        for column in range(WRITE_SIZE):
            writes[row, column] = writes[row - 1, column]
    writes[0, 0], writes[0, 1], writes[0, 2], writes[0, WRITE_WAIT] = x, y, z, wait_s


@kernel
def pass_time(writes: FloatArray, dt_s: float, mean: FloatArray) -> None:
    """Let `dt_s` pass, and write the mean force over it into `mean` (3,)."""
    if writes[0, WRITE_WAIT] == 0.0:
        mean[0], mean[1], mean[2] = writes[0, 0], writes[0, 1], writes[0, 2]
        return
    mean[0] = mean[1] = mean[2] = 0.0
    until = dt_s
    for row in range(WRITES):
        since = 0.0 if row == WRITES - 1 else min(writes[row, WRITE_WAIT], until)
        share = (until - since) / dt_s
        for axis in range(3):
            mean[axis] += share * writes[row, axis]
        until = since
        writes[row, WRITE_WAIT] = max(0.0, writes[row, WRITE_WAIT] - dt_s)
