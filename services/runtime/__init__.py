"""What a process needs and nothing of physics: bus, deadline loop, real-time set-up, configuration, health."""

import os

# One thread for every numerics library, set before any of them is imported: a second one would leave the core and the
# priority that the loop was given.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")
