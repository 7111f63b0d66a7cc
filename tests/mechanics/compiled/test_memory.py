"""Arrays of any kind are copied whole in one call, and what could not be is refused before."""

from __future__ import annotations

import numpy as np
import pytest

from trocar.services.mechanics.compiled.memory import (
    PAGE_WORDS,
    SavedArrays,
    SavedPages,
    SavedRows,
    copy_arrays,
    copy_table,
)


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


def test_arrays_are_as_saved_until_a_number_of_one_of_them_is_another() -> None:
    live = [np.zeros((4, 3)), np.arange(5)]
    saved = SavedArrays(live)
    assert saved.are_as_saved()
    live[0][3, 2] = 1e-300
    assert not saved.are_as_saved()
    saved.save()
    assert saved.are_as_saved()


def test_rows_that_were_saved_come_back_and_no_others() -> None:
    live = [np.arange(12.0).reshape(4, 3), np.arange(4, dtype=np.int8), np.arange(8.0).reshape(4, 2, 1)]
    saved = SavedRows(live)
    saved.save(2)
    for array in live:
        array[:] = -1
    saved.restore()
    assert saved.count == 2
    np.testing.assert_array_equal(live[0], [[0, 1, 2], [3, 4, 5], [-1, -1, -1], [-1, -1, -1]])
    np.testing.assert_array_equal(live[1], [0, 1, -1, -1])
    np.testing.assert_array_equal(live[2][:, :, 0], [[0, 1], [2, 3], [-1, -1], [-1, -1]])


@pytest.mark.parametrize("size", [1, PAGE_WORDS - 1, PAGE_WORDS, 5 * PAGE_WORDS + 7])
def test_an_array_saved_by_pages_comes_back_whatever_was_written_to_it(size: int) -> None:
    rng = np.random.default_rng(size)
    for filled in ([], [0], [size - 1], sorted(set(rng.integers(0, size, 3).tolist()))):
        live = np.zeros(size)
        live[filled] = rng.normal(size=len(filled))
        live[filled[:1]] = -0.0
        before, saved = live.copy(), SavedPages(live)
        for written in (slice(None), filled, [size // 2], []):
            live[written] = np.nan
            saved.restore()
            assert live.tobytes() == before.tobytes()


def test_pages_without_content_are_not_kept() -> None:
    live = np.zeros((1000, PAGE_WORDS // 8, 8))
    live[417, 3, 5] = 1.0
    assert SavedPages(live).nbytes == 8 * PAGE_WORDS + 8
    with pytest.raises(ValueError, match="only contiguous"):
        SavedPages(live[:, ::2])


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
