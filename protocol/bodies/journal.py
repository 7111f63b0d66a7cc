"""What a loop took in, tick by tick: with the device frames, all that a recording needs to be run again to the bit."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from trocar.protocol.arrays import Array, spec

RUN_TICK, RUN_COUNT, RUN_STRIDE, RUN_FACTS, RUN_COLUMNS = 0, 1, 2, 3, 6


class Journal(msgspec.Struct, array_like=True, frozen=True, kw_only=True):
    """Processed ticks, in runs with equal facts.

    Facts of haptics: by how many ticks the newest known state of physics was older than the device frame, -1 for none;
    1 if it was fresh; the frame's sequence less its tick, as a tick at which the rig's time stands has several. Facts
    of physics: ticks that the simulation was to go on by; rung of the quality ladder; how often it had begun anew.
    """

    noted: Annotated[int, Meta(ge=0, description="ticks noted before these, since the process began")]
    runs: Annotated[
        Array, spec("<i8", ("runs", RUN_COLUMNS), "first tick, number of ticks, ticks from one to the next; 3 facts")
    ]
