"""Readers as foreign files make them."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Iterator


class Told(Exception):  # noqa: N818
    is_told = True


def sized(path: str, sizes: list[int]) -> Iterator[bytes]:
    for size in sizes:
        yield bytes(size)


def takes_memory(path: str) -> Iterator[bytes]:
    yield bytes(1 << 30)


def computes(path: str) -> Iterator[bytes]:
    while path:
        pass
    yield b""


def sends_without_end(path: str) -> Iterator[bytes]:
    while path:
        yield bytes(1 << 20)


def crashes(path: str) -> Iterator[bytes]:
    print("words of a library", file=sys.stderr, flush=True)
    os.kill(os.getpid(), signal.SIGSEGV)
    yield b""


def aborts(path: str) -> Iterator[bytes]:
    os.abort()
    yield b""


def leaves(path: str) -> Iterator[bytes]:
    os._exit(3)
    yield b""


def raises(path: str) -> Iterator[bytes]:
    raise ArithmeticError("two\n lines")
    yield b""


def tells(path: str) -> Iterator[bytes]:
    raise Told(f"{path}: is told")
    yield b""


def says_who_it_is_and_sleeps(path: str) -> Iterator[bytes]:
    yield str(os.getpid()).encode()
    time.sleep(600.0)
