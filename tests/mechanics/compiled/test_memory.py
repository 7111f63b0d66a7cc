"""Arrays of any kind are copied whole in one call, and what could not be is refused before."""

from __future__ import annotations

import numpy as np
import pytest

from trocar.services.mechanics.compiled.memory import SavedArrays, copy_arrays, copy_table


def test_arrays_of_any_kind_are_copied_and_nothing_beside_them() -> None:
    rng = np.random.default_rng(1)
    sources = [rng.normal(size=(7, 3)), rng.integers(0, 9, 5).astype(np.int32), rng.random(11) < 0.5, np.zeros(0)]
    room = [np.zeros((len(source) + 2, *source.shape[1:]), source.dtype) for source in sources]
    targets = [array[1:-1] for array in room]
    table = copy_table(targets, sources)
    sources[0][2, 1] = np.nan
    copy_arrays(table)
    for target, source, array in zip(targets, sources, room, strict=True):
        np.testing.assert_array_equal(target, source)
        assert not array[0].any()
        assert not array[-1].any()


def test_what_was_saved_last_comes_back() -> None:
    live = [np.zeros((4, 3)), np.arange(5)]
    saved = SavedArrays(live)
    for k in (1, 2):
        live[0][:], live[1][:] = k, k
        saved.save()
    live[0][:], live[1][2] = np.nan, -1
    saved.restore()
    np.testing.assert_array_equal(live[0], 2.0)
    np.testing.assert_array_equal(live[1], 2)


@pytest.mark.parametrize(
    ("target", "source"),
    [
        (np.zeros(3), np.zeros(4)),
        (np.zeros(3), np.zeros(3, np.float32)),
        (np.zeros((3, 2))[:, 0], np.zeros(3)),
        (np.zeros(3), np.zeros(6)[::2]),
    ],
)
def test_what_is_not_alike_is_refused(target: np.ndarray, source: np.ndarray) -> None:
    with pytest.raises(ValueError, match="copied"):
        copy_table([target], [source])
