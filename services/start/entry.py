"""What a process of ours sets for itself and its children, before numpy and numba are imported.

The first import of every module that is started, by ``python -m`` or as the command ``trocar``. A program that imports
Trocar as a library does not import this module: its environment, threads and numba's settings stay as they are.
"""

from __future__ import annotations

from trocar.services.start import interrupts

interrupts.begin()  # before all that takes time

import os  # noqa: E402

from trocar.services.kernels.processor import numba_target  # noqa: E402
from trocar.services.start import start_up  # noqa: E402

#: One thread for every numerics library, as a second one would leave the loop's core and priority.
_THREADS = "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"

for _variable in _THREADS:
    os.environ.setdefault(_variable, "1")
for _variable, _value in numba_target().items():
    os.environ.setdefault(_variable, _value)
start_up.begin()
