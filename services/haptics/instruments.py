"""The instruments of a device frame as a table for kernels."""

from __future__ import annotations

import struct
from itertools import islice

import numpy as np

from trocar.protocol.bodies import InstrumentState
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.scene.tools import N_TOOLS
from trocar.services.runtime.loop.flat_view import flat_view

# Columns: three for the HIP, three for its velocity, three for the port, and these.
VELOCITY, PORT, ROLL, HANDLE, HANDLE_RATE, INSTRUMENT_COLUMNS = 3, 6, 9, 10, 11, 12
_put = struct.Struct(f"<{INSTRUMENT_COLUMNS}d").pack_into
_ROW_BYTES = INSTRUMENT_COLUMNS * np.dtype(float).itemsize


class InstrumentTable:
    """The instruments for which the scene has tools.

    Attributes:
        rows: (2, INSTRUMENT_COLUMNS) float64. The first `count` are valid.
    """

    def __init__(self, n_forceps: int) -> None:
        self.rows: FloatArray = np.zeros((N_TOOLS, INSTRUMENT_COLUMNS))
        self._bytes = flat_view(self.rows).cast("B")
        self.count = 0
        self._most = min(n_forceps, N_TOOLS)

    def take_states(self, instruments: tuple[InstrumentState, ...]) -> None:
        """Copy poses and velocities of the instruments, without those beyond the scene's tools."""
        self.count = min(len(instruments), self._most)
        for row, each in enumerate(islice(instruments, self.count)):
            _put(
                self._bytes, row * _ROW_BYTES, *each.position_m, *each.velocity_m_s, *each.port_m,
                each.roll_rad, each.handle_angle_rad, each.handle_rate_rad_s,
            )  # fmt: skip
