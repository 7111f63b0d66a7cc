"""A message box between two threads of which neither may wait: the newest message, whole, or the one before.

One thread writes, one reads. There are two places; a message is put into the one that was not published last, then
published by its number. A writer that is interrupted in the middle holds up nobody. A reader whose place was written to
meanwhile, which takes two messages, looks again.
"""

from __future__ import annotations

from typing import Annotated

from services.gateway.hdapi import native
from services.mechanics.arrays import FloatArray
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Struct

#: A message a millisecond overtakes nobody who reads for a microsecond more than once.
_TRIES = 3


class Box(Struct):
    """Messages of n numbers; the first is `number` 1."""

    places: Annotated[FloatArray, 2, "n"]
    number: int = 0


@kernel
def put(box: Box, message: FloatArray) -> None:
    """Publish a message (n,)."""
    number = box.number + 1
    place = number & 1
    native.fence()
    for i in range(message.shape[0]):
        box.places[place, i] = message[i]
    native.fence()
    box.number = number


@kernel
def take(box: Box, message: FloatArray) -> int:
    """Write the newest message into `message` (n,) and return its number, 0 if there is none.

    A reader that is overtaken again and again gets -1, and parts of several messages: nothing to be used.
    """
    for _ in range(_TRIES):
        number = box.number
        if number == 0:
            return 0
        native.fence()
        place = number & 1
        for i in range(message.shape[0]):
            message[i] = box.places[place, i]
        native.fence()
        if box.number == number:
            return number
    return -1
