"""Frames of one topic from msgpack to records of an MCAP chunk: the pass over their bytes, compiled.

What a body is made of comes as a program, one row a step (`services.recorder.batches` makes it). Whatever is not
exactly a frame as a publisher of today sends it ends the pass: who called it then looks at each frame by itself.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from services.mechanics.arrays import AnyArray, LongArray
from services.mechanics.compiled import kernel
from services.recorder.msgpack_kernel import array_head, big_endian, bytes_head, integer, is_ascii, word, word_head
from services.recorder.protobuf_kernel import close, copy, put_little_endian, put_number, put_varint

#: Steps of a program, and what stands in their row after the tag of the field. Those up to `END` begin or end a body.
FIELDS = 0  # of a body: how many; first and last + 1 of the dimensions that it names
BODY = 1  # a body that is always there
BODIES = 2  # most; row after the matching END
END = 3  # of a body: row to go back to where others follow
NUMBER = 4  # least, most, as `number_key` has them
VECTOR = 5  # how many numbers
TRUTH = 6
INTEGER = 7  # least, most
WORD = 8  # longest
ARRAY = 9  # dtype as `dtype_code` has it; size of an item; first of its dimensions, how many

#: Columns of what is found of each frame.
INCARNATION, SEQUENCE, SENT_NS, ORIGIN_NS, VALID, OFFSET, HEADS = 0, 1, 2, 3, 4, 5, 6

_ENVELOPE = (1000 << 3) | 2
_MESSAGE, _MESSAGE_HEAD = 5, 31
DEEPEST = 8
#: Room that a step needs beside the bytes that it copies: tag, length, number.
ROOM = 32


@kernel
def dtype_code(a: int, b: int, c: int) -> int:
    """Return three letters as one number."""
    return a | b << 8 | c << 16


class Plan(NamedTuple):
    """How frames of a topic are written, and into which file.

    Attributes
    ----------
    program, declared
        Of the topic's body: see `services.recorder.batches`. (steps, 6) and (dimensions,).
    name, version
        Of the topic: bytes, and its body's version.
    channel, to_wall_ns
        Of the file: the topic's number in it, and wall clock less monotonic clock in ns.
    """

    program: LongArray
    declared: LongArray
    name: AnyArray
    version: int
    channel: int
    to_wall_ns: int


@kernel
def number_key(bits: int) -> int:
    """Return the bits of a double as an integer that grows with it; numbers that are none lie beyond the infinite."""
    return bits if bits >= 0 else bits ^ 0x7FFFFFFFFFFFFFFF


@kernel
def _array(row: Any, declared: Any, data: Any, at: int, end: int, lengths: Any) -> tuple[int, int]:
    """Return size and beginning of the bytes of an array that is what its body declares; -1 for any other."""
    n, at = array_head(data, at, end)
    if at < 0 or n != 3:
        return 0, -1
    n, at = word_head(data, at, end)
    if at < 0 or n != 3 or at + 3 > end or dtype_code(int(data[at]), int(data[at + 1]), int(data[at + 2])) != row[2]:
        return 0, -1
    n, at = array_head(data, at + 3, end)
    if at < 0 or n != row[5]:
        return 0, -1
    size = row[3]
    for k in range(row[4], row[4] + row[5]):
        length, at = integer(data, at, end)
        expected = declared[k] if declared[k] >= 0 else lengths[-1 - declared[k]]
        if at < 0 or length < 0 or length > end or (expected >= 0 and length != expected):
            return 0, -1
        if expected < 0:
            lengths[-1 - declared[k]] = length
        size *= length
        if size > end:
            return 0, -1
    n, at = bytes_head(data, at, end)
    if at < 0 or n != size or at + n > end:
        return 0, -1
    if row[3] == 1 and not is_ascii(data, at, n):  # bytes that are no varints: a negative number takes ten
        return 0, -1
    return n, at


@kernel
def _body(plan: Plan, data: Any, at: int, end: int, out: Any, to: int, scratch: Any) -> tuple[int, int]:
    """Transcode one body; return where it ends in both, -1 for one that is to be looked at by itself.

    Numbers in one piece: with a kernel for each kind of value, 64 frames of ``gateway.state`` took 45 us instead of 33.
    """
    program, depth, step = plan.program, 0, 0
    while step < len(program):
        row = program[step]
        kind = row[0]
        if at < 0 or to + ROOM > len(out):
            return -1, to
        if kind <= END:
            step, depth, at, to = _turn(row, (step, depth), data, at, end, out, to, scratch)
            continue
        to, step = put_varint(out, to, row[1]), step + 1
        if kind == NUMBER:
            at = put_number(data, at, end, out, to)
            if at >= 0:
                key = number_key(big_endian(data, at - 8, 8))
                if key < row[2] or key > row[3]:
                    return -1, to
            to += 8
        elif kind == VECTOR:
            n, at = array_head(data, at, end)
            if at < 0 or n != row[2] or to + 8 * n + ROOM > len(out):
                return -1, to
            to = put_varint(out, to, 8 * n)
            for _ in range(n):
                at = put_number(data, at, end, out, to)
                to += 8
        elif kind in (TRUTH, INTEGER):
            at, to = _whole(row, data, at, end, out, to)
        else:
            at, to = _bytes(row, plan.declared, data, at, end, out, to, scratch[0])
    return at, to


@kernel
def _turn(
    row: Any, place: tuple[int, int], data: Any, at: int, end: int, out: Any, to: int, scratch: Any
) -> tuple[int, int, int, int]:
    """Begin or end a body; return the step that follows, how deep it is, and where both are, -1 for none of today's.

    ``place`` are step and depth.
    """
    lengths, marks, left = scratch[0], scratch[1], scratch[2]
    (step, depth), follows, n = place, place[0] + 1, 1
    if row[0] == FIELDS:
        n, at = array_head(data, at, end)
        for k in range(row[3], row[4]):
            lengths[k] = -1
        return follows, depth, at if n == row[2] else -1, to
    if row[0] == END:
        depth -= 1
        to = close(out, marks[depth], to)
        n, follows = left[depth] - 1, row[2] if left[depth] > 1 else follows
    elif row[0] == BODIES:
        n, at = array_head(data, at, end)
        follows = follows if n > 0 else row[3]
        if at < 0 or n > row[2]:
            return step, depth, -1, to
    if n == 0:
        return follows, depth, at, to
    to = put_varint(out, to, row[1])
    left[depth], marks[depth] = n, to
    return follows, depth + 1, at, to + 2


@kernel
def _whole(row: Any, data: Any, at: int, end: int, out: Any, to: int) -> tuple[int, int]:
    """Write a truth or an integer; return where what follows is in both, -1 where there is none within its limits."""
    if row[0] == TRUTH:
        if at >= end or data[at] & 0xFE != 0xC2:
            return -1, to
        out[to] = data[at] & 1
        return at + 1, to + 1
    n, at = integer(data, at, end)
    if at < 0 or n < row[2] or n > row[3]:
        return -1, to
    return at, put_varint(out, to, n)


@kernel
def _bytes(row: Any, declared: Any, data: Any, at: int, end: int, out: Any, to: int, lengths: Any) -> tuple[int, int]:
    """Copy a word or an array behind its length; return where what follows is in both, -1 for none that is declared."""
    if row[0] == WORD:
        n, at = word(data, at, end, row[2])
    else:
        n, at = _array(row, declared, data, at, end, lengths)
    if at < 0 or to + n + ROOM > len(out):
        return -1, to
    to = put_varint(out, to, n)
    copy(data, at, n, out, to)
    return at + n, to + n


@kernel
def _envelope(plan: Plan, data: Any, at: int, end: int, head: Any) -> int:
    """Read what stands before the body; return where that begins, -1 for a frame that is not of topic and version."""
    name = plan.name
    n, at = array_head(data, at, end)
    protocol, at = integer(data, at, end) if n == 9 else (0, -1)
    length, at = word_head(data, at, end) if protocol == 1 else (0, -1)
    if at < 0 or length != len(name) or at + length > end:
        return -1
    for k in range(length):
        if data[at + k] != name[k]:
            return -1
    n, at = integer(data, at + length, end)
    if n != plan.version:
        return -1
    for k in range(VALID):
        head[k], at = integer(data, at, end)
        if at < 0 or head[k] < 0:
            return -1
    if at >= end or data[at] & 0xFE != 0xC2:
        return -1
    head[VALID] = data[at] & 1
    return at + 1


@kernel
def _put_envelope(out: Any, to: int, version: int, head: Any) -> int:
    to = put_varint(out, to, _ENVELOPE)
    mark = to
    to = put_varint(out, to + 2, 1 << 3)
    to = put_varint(out, to, version)
    for k in range(VALID + 1):
        to = put_varint(out, to, (k + 2) << 3)
        to = put_varint(out, to, head[k])
    return close(out, mark, to)


@kernel
def transcode(plan: Plan, data: Any, lengths: Any, out: Any, heads: Any, scratch: Any) -> int:
    """Write frames one after the other as message records; return how many bytes they take.

    Parameters
    ----------
    plan : Plan
    data, lengths
        The frames one after the other, and their lengths in bytes, (frames,).
    out
        Taken by the records.
    heads
        Written: what is found of each frame, (frames, HEADS).
    scratch
        Overwritten: (3, dimensions or DEEPEST).

    Returns
    -------
    int
        -1 if there is a frame that is to be looked at by itself, or too little room.
    """
    begin, to = 0, 0
    for k in range(len(lengths)):
        end = begin + int(lengths[k])
        heads[k, OFFSET] = to
        at = _envelope(plan, data, begin, end, heads[k])
        if at < 0 or to + _MESSAGE_HEAD + ROOM > len(out):
            return -1
        at, body_end = _body(plan, data, at, end, out, to + _MESSAGE_HEAD, scratch)
        if at != end or body_end + 4 * ROOM > len(out):
            return -1
        to = _put_message(plan, out, to, body_end, heads[k])
        begin = end
    return to


@kernel
def _put_message(plan: Plan, out: Any, record: int, to: int, head: Any) -> int:
    """Write what stands before the body of a record and what follows it; return where the next one goes."""
    to = _put_envelope(out, to, plan.version, head)
    sent_ns = head[SENT_NS] + plan.to_wall_ns
    origin_ns = head[ORIGIN_NS] + plan.to_wall_ns if head[ORIGIN_NS] else sent_ns
    out[record] = _MESSAGE
    at = put_little_endian(out, record + 1, 8, to - record - 9)
    at = put_little_endian(out, at, 2, plan.channel)
    at = put_little_endian(out, at, 4, head[SEQUENCE])
    at = put_little_endian(out, at, 8, sent_ns)
    put_little_endian(out, at, 8, origin_ns)
    return to
