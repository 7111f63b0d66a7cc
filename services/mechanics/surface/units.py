"""Units of length in surface files, as no file format states them."""

from __future__ import annotations

from typing import Literal

LengthUnit = Literal["m", "cm", "mm", "um", "in"]
METRES_PER_UNIT: dict[str, float] = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 25.4e-3}
