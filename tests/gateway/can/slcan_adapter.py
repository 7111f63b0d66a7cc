"""An slcan adapter behind a pseudo terminal: a bus for the emulated drive, a serial port for the driver."""

from __future__ import annotations

import fcntl
import os
import select
import struct
import termios
import time
import tty
from collections import deque

import can

_SOON_S = 20.0


class Adapter(can.BusABC):  # type: ignore[misc]
    """Acknowledges every frame with a ``z`` as adapters do. Nothing is sent before the bus is open."""

    def __init__(self) -> None:
        self._own, self._port = os.openpty()
        tty.setraw(self._port)
        os.set_blocking(self._own, False)
        self.port_name = os.ttyname(self._port)
        self.commands: list[str] = []
        self.is_open = False
        self._begun = b""
        self._frames: deque[can.Message] = deque()
        super().__init__(channel="adapter")

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        if self.is_open and self._own >= 0:
            self._write(f"t{msg.arbitration_id:03X}{msg.dlc}{msg.data.hex().upper()}\r".encode())

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if self._own >= 0:
            self.hear(0.0)
        return (self._frames.popleft() if self._frames else None), True

    def hear(self, seconds: float = _SOON_S) -> None:
        """Take what the driver has written; with `seconds`, wait for it: the kernel hands it on by and by."""
        if not select.select((self._own,), (), (), seconds)[0]:
            return
        *lines, self._begun = (self._begun + os.read(self._own, 4096)).split(b"\r")
        for line in lines:
            self._obey(line.decode())

    def _obey(self, line: str) -> None:
        self.commands.append(line[:1])
        if line[:1] == "t":
            data = bytes.fromhex(line[5 : 5 + 2 * int(line[4])])
            self._frames.append(can.Message(arbitration_id=int(line[1:4], 16), data=data, is_extended_id=False))
            self._write(b"z\r")
        elif line[:1] == "r":
            identifier = int(line[1:4], 16)
            self._frames.append(can.Message(arbitration_id=identifier, is_remote_frame=True, is_extended_id=False))
            self._write(b"z\r")
        else:
            self.is_open = (self.is_open or line == "O") and line != "C"
            self._write(b"\r")

    def _write(self, data: bytes) -> None:
        """Write, and wait until the port has it."""
        had = self._waiting()
        os.write(self._own, data)
        until_s = time.monotonic() + _SOON_S
        while self._waiting() < had + len(data) and time.monotonic() < until_s:
            time.sleep(0.0)

    def _waiting(self) -> int:
        return int(struct.unpack("i", fcntl.ioctl(self._port, termios.FIONREAD, b"\0" * 4))[0])

    def say(self, line: bytes) -> None:
        """Write a line of one's own."""
        self._write(line)

    def shutdown(self) -> None:
        super().shutdown()
        if self._own >= 0:
            os.close(self._own)
            os.close(self._port)
        self._own = -1
