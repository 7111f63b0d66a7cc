"""Array types by the numbers in them, each defined here and nowhere else.

They are written out, as structs read them: `numpy.typing.NDArray` is an alias whose parts hide since NumPy 2.5.
"""

from typing import Any

import numpy as np

AnyArray = np.ndarray[tuple[Any, ...], np.dtype[Any]]
FloatArray = np.ndarray[tuple[Any, ...], np.dtype[np.float64]]
Float32Array = np.ndarray[tuple[Any, ...], np.dtype[np.float32]]
IntArray = np.ndarray[tuple[Any, ...], np.dtype[np.int32]]
LongArray = np.ndarray[tuple[Any, ...], np.dtype[np.int64]]
ByteArray = np.ndarray[tuple[Any, ...], np.dtype[np.int8]]
BoolArray = np.ndarray[tuple[Any, ...], np.dtype[np.bool_]]
