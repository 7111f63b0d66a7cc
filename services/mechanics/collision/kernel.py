"""Moved to `services.mechanics.kernel`."""

from services.mechanics.kernel import (
    Struct,
    fill,
    flags,
    floats,
    ints,
    kernel,
    longs,
    nest,
    struct_type,
    summing_kernel,
)

__all__ = ["Struct", "fill", "flags", "floats", "ints", "kernel", "longs", "nest", "struct_type", "summing_kernel"]
