"""Small fixed vectors: flat msgpack arrays of floats whose length the decoder enforces."""

from __future__ import annotations

Vec3 = tuple[float, float, float]
#: Unit quaternion, scalar first.
Quat = tuple[float, float, float, float]
#: 3 x 3 matrix, row by row.
Mat3 = tuple[float, float, float, float, float, float, float, float, float]

ZERO3: Vec3 = (0.0, 0.0, 0.0)
ZERO9: Mat3 = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
IDENTITY_QUAT: Quat = (1.0, 0.0, 0.0, 0.0)  # w first: no rotation, as the cosine of 0 is 1
