"""Ports of test rigs: of no other test run on this machine, nor those that the system gives to whoever asks.

A port that the system calls free may be somebody's connection before it is bound, and two checkouts number their
workers alike. So each process of a test run takes a number that no other has, for as long as it lives: an abstract
socket, which the system gives to one alone. Its ports follow from it.
"""

from __future__ import annotations

import functools
import itertools
import os
import socket

#: As many runs share a machine at most; topics of a rig are `23` ports apart at least.
_NUMBERS = 23
#: Below what the system gives to connections (32,768 on), and below the topics of `base_port`.
_FIRST, _EACH = 10_000, 400
_tried = itertools.count()


@functools.cache
def _number_of(_pid: int) -> int:
    """Return the number of this process; a fork has one of its own."""
    for number in range(_NUMBERS):
        holder = socket.socket(socket.AF_UNIX)
        try:
            holder.bind(f"\0trocar-tests-{number}")
        except OSError:
            holder.close()
        else:
            holder.detach()  # open until this process ends
            return number
    raise RuntimeError(f"{_NUMBERS} test runs on this machine have all ports")


def base_port(first: int) -> int:
    """Return a rig's ``base_port`` near `first`, which is at most 24,576: topics lie up to 8,192 above it."""
    return first + _number_of(os.getpid())


def free_port() -> int:
    """Return a port for TCP or UDP that nobody has, another one with each call."""
    begin = _FIRST + _EACH * _number_of(os.getpid())
    for _ in range(_EACH):
        port = begin + next(_tried) % _EACH
        if all(_is_free(port, kind) for kind in (socket.SOCK_STREAM, socket.SOCK_DGRAM)):
            return port
    raise RuntimeError(f"all ports from {begin} to {begin + _EACH - 1} are taken")


def _is_free(port: int, kind: int) -> bool:
    with socket.socket(socket.AF_INET, kind) as probe:
        try:
            probe.bind(("", port))
        except OSError:
            return False
    return True
