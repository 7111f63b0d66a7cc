"""A claim on a command: taken once, by whoever carries the command out or by its sender who gives up.

A deadline alone leaves a gap: who is stopped between a look at the clock and the deed does it late. The claim is an
eventfd that goes with the command over a Unix socket, and the kernel gives its one count to one of both.
"""

from __future__ import annotations

import array
import contextlib
import os
import socket
from typing import Self

_MOST = 4  # descriptors that are received, and closed but for the first


class Claim:
    """One end's hold on a claim, which it closes."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor

    @classmethod
    def new(cls) -> Self:
        """Return a claim that nobody has taken."""
        return cls(os.eventfd(1, os.EFD_NONBLOCK | os.EFD_CLOEXEC))

    def send_with(self, link: socket.socket, message: bytes) -> None:
        """Send a message that is only carried out if its receiver can take this claim; raises as `sendmsg` does."""
        rights = socket.SOL_SOCKET, socket.SCM_RIGHTS, array.array("i", [self._descriptor])
        link.sendmsg([message], [rights], socket.MSG_NOSIGNAL)

    @classmethod
    def receive(cls, link: socket.socket, most_bytes: int) -> tuple[bytes, Self | None, str | bytes]:
        """Return the next message, the claim that came with it, if any, and its sender; raises as `recvmsg` does."""
        descriptors = array.array("i")
        room = socket.CMSG_SPACE(_MOST * descriptors.itemsize)
        data, ancillary, _, sender = link.recvmsg(most_bytes, room, socket.MSG_DONTWAIT | socket.MSG_CMSG_CLOEXEC)
        for level, kind, content in ancillary:
            if (level, kind) == (socket.SOL_SOCKET, socket.SCM_RIGHTS):
                descriptors.frombytes(content[: len(content) - len(content) % descriptors.itemsize])
        for each in descriptors[1:]:
            os.close(each)
        return data, cls(descriptors[0]) if descriptors else None, sender

    def take(self) -> bool:
        """Return whether the claim is this end's from now on. Never waits."""
        try:
            return os.eventfd_read(self._descriptor) > 0
        except OSError:  # it is the other's, or no claim at all
            return False

    def close(self) -> None:
        """Let go of it; what was taken stays taken."""
        with contextlib.suppress(OSError):
            os.close(self._descriptor)
