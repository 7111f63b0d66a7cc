"""Infrastructure of every process, without physics: bus, deadline loop, real-time set-up, configuration, health."""

import os

# One thread for every numerics library, set before any is imported, as a second one would leave the loop's core and
# priority.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")
