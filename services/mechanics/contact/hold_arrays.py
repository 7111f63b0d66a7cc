"""What is known of each hold, one slot of arrays a hold."""

from __future__ import annotations

from typing import Annotated

from services.mechanics.arrays import BoolArray, ByteArray, FloatArray, IntArray, LongArray
from services.mechanics.compiled.struct import Struct, reader
from services.mechanics.scene.tools import N_TOOLS


class HoldArrays(Struct):
    """Holds by slot; ``order`` lists the slots in use, in the order of their rows."""

    order: Annotated[IntArray, "h"]
    number: Annotated[LongArray, "h"]  # the request's
    tool: Annotated[ByteArray, "h"]
    target_kind: Annotated[ByteArray, "h"]
    target: Annotated[IntArray, "h"]
    weights: Annotated[FloatArray, "h", 3]
    anchor: Annotated[FloatArray, "h", 3]  # along b, h and d of the tool from J, in m
    slipped_m: Annotated[FloatArray, "h"]
    lost: Annotated[BoolArray, "h"]
    reach: Annotated[FloatArray, N_TOOLS, 2]  # of each tool's jaws beyond J: across, and along d


holds_at = reader(HoldArrays)
