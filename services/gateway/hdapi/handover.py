"""A wait-free message box between two threads: the reader gets the newest complete message.

One thread writes, one reads. There are two places; a message is written to the one that was not published last, then
published by its number. An interrupted writer blocks nobody. A reader whose place was overwritten meanwhile, which
takes two messages, tries again.
"""

from __future__ import annotations

from typing import Annotated

from trocar.services.gateway.hdapi import native
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Struct

#: Attempts of a reader; with a message a millisecond, a read of a microsecond is overtaken at most once.
_TRIES = 3


class Box(Struct):
    """Messages of n numbers; the first is `number` 1."""

    places: Annotated[FloatArray, 2, "n"]
    number: int = 0


@kernel
def put_message(box: Box, message: FloatArray) -> None:
    """Publish a message (n,)."""
    number = box.number + 1
    place = number & 1
    native.fence()
    for i in range(message.shape[0]):
        box.places[place, i] = message[i]
    native.fence()
    box.number = number


@kernel
def take_message(box: Box, message: FloatArray) -> int:
    """Write the newest message into `message` (n,) and return its number, 0 if there is none.

    A reader that is overtaken repeatedly gets -1, and a mixture of messages that must not be used.
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
