"""The identity of a contact: a number that names the pair of bodies and stays the same from tick to tick.

Its bit fields, from the lowest:

======== ==== =================================================
target     24 triangle of the duct or segment of the catheter
kind        1 `pairs.DUCT_TRIANGLE` or `pairs.CATHETER_SEGMENT`
particle   20 first particle of the catheter's side, plus 1; stones are numbered after its segments
segment     2 `SHAFT`, `JAW_A` or `JAW_B`
tool        2 tool, plus 1
law         7 number of the contact law
======== ==== =================================================

Without its target an identity names only the first body and the kind of target, which stay the same when a contact
slides to the next triangle. Identities of holds are negative and come from the numbers of the holds.
"""

from __future__ import annotations

from typing import NamedTuple

from trocar.services.mechanics.compiled import inlined_kernel, kernel


class BitField(NamedTuple):
    """Position (bit) of a part of the identity, and the number of its values."""

    shift: int
    size: int


TARGET = BitField(0, 1 << 24)
TARGET_KIND = BitField(24, 1 << 1)
PARTICLE = BitField(25, 1 << 20)
SEGMENT = BitField(45, 1 << 2)
TOOL = BitField(47, 1 << 2)
LAW = BitField(49, 1 << 7)


@kernel
def pair_identity(tool: int, segment: int, particle: int, target_kind: int, target: int) -> int:
    """Return the identity of a detected pair; ``tool`` may be `NO_TOOL`, and ``particle`` -1 for none."""
    first_body = ((tool + 1) << TOOL.shift) | (segment << SEGMENT.shift) | ((particle + 1) << PARTICLE.shift)
    return first_body | (target_kind << TARGET_KIND.shift) | (target << TARGET.shift)


@kernel
def with_law(identity: int, law: int) -> int:
    """Return the identity of a second contact of the same pair, under another law."""
    return identity | (law << LAW.shift)


@inlined_kernel
def hold_identity(number: int) -> int:
    """Return the identity of a hold, which is unique even without its target."""
    return -(number + 1) * TARGET.size


@kernel
def without_target(identity: int) -> int:
    """Return the part of an identity that names the first body and the kind of target."""
    return identity >> TARGET_KIND.shift


@kernel
def part_of(identity: int, field: BitField) -> int:
    """Return a part of a pair's identity, as the table gives it."""
    return (identity >> field.shift) & (field.size - 1)
