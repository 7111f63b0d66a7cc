"""The message box between two threads, and what its kernels owe each other."""

from __future__ import annotations

import threading

import numpy as np

from trocar.services.gateway.hdapi.handover import Box, put_message, take_message
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Address, reader

N = 20
_at = reader(Box)


@kernel
def _put_many(address: Address[Box], message: FloatArray, many: int) -> None:
    for k in range(many):
        message[:] = k
        put_message(_at(address), message)


@kernel
def _take_many(address: Address[Box], message: FloatArray, last: int, counts: FloatArray) -> None:
    """Count whole, torn, overtaken and older messages until the one of number `last` is seen."""
    newest = 0
    while newest < last:
        number = take_message(_at(address), message)
        if number < 0:
            counts[2] += 1
            continue
        if number == 0:
            continue
        counts[0] += 1
        if number < newest:
            counts[3] += 1
        newest = number
        for i in range(message.shape[0]):
            if message[i] != number - 1:
                counts[1] += 1
                break


def test_an_empty_box_says_so_and_then_holds_the_newest() -> None:
    box, message = Box.zeros(n=N), np.zeros(N)

    @kernel
    def take_once(address: Address[Box], out: FloatArray) -> int:
        return take_message(_at(address), out)

    assert take_once(box.address, message) == 0
    _put_many(box.address, np.zeros(N), 3)
    assert take_once(box.address, message) == 3
    np.testing.assert_array_equal(message, 2.0)


def test_no_message_is_torn_or_goes_back_however_the_threads_run() -> None:
    box, counts, many = Box.zeros(n=N), np.zeros(4), 1_000_000
    _put_many(box.address, np.zeros(N), 0)  # compiled, so that the two run side by side
    _take_many(box.address, np.zeros(N), 0, counts)
    writer = threading.Thread(target=_put_many, args=(box.address, np.zeros(N), many))
    writer.start()
    _take_many(box.address, np.zeros(N), many, counts)
    writer.join()
    whole, torn, _overtaken, older = counts
    assert whole > 0
    assert torn == 0
    assert older == 0


def test_a_writer_that_is_interrupted_holds_up_nobody() -> None:
    box, message = Box.zeros(n=N), np.zeros(N)
    _put_many(box.address, np.zeros(N), 4)
    box.places[1, : N // 2] = 99.0  # the fifth message, half written
    counts = np.zeros(4)
    _take_many(box.address, message, 4, counts)
    np.testing.assert_array_equal(message, 3.0)
    np.testing.assert_array_equal(counts, [1, 0, 0, 0])
