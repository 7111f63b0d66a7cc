from __future__ import annotations

import numpy as np
import pytest

from trocar.services.runtime.loop.flat_view import flat_view


@pytest.mark.parametrize(("kind", "item"), [(np.float64, 2.5), (np.bool_, True), (np.int32, 7)])
def test_what_is_put_into_the_view_is_in_the_array(kind: type, item: float) -> None:
    array = np.zeros((2, 3), kind)
    view = flat_view(array)
    view[4] = item
    assert array[1, 1] == item
    assert view[4] == item
    assert len(view) == array.size


def test_an_array_with_gaps_has_no_flat_view() -> None:
    """A copy would be made of it, and what is written there lost."""
    with pytest.raises(ValueError, match="contiguous"):
        flat_view(np.zeros((4, 4))[:, :2])
