"""CAN adapters on a serial line that speak slcan (Lawicel), read and written as a servo loop must: without waiting."""

from __future__ import annotations

import os
import termios
from collections import deque
from typing import Any

import can
from can.interfaces.slcan import slcanBus

#: Lines that are frames; others answer commands: a "z" for each frame sent, an empty one, a bell for a mistake.
_FRAMES = (b"t", b"T", b"r", b"R")
_ENDS = bytes.maketrans(b"\a", b"\r")
_READ = 4096
#: No line is longer: a frame of eight bytes has 26 letters, and a time behind it four.
_LONGEST = 64


class SlcanBus(slcanBus):  # type: ignore[misc]  # python-can is not read by mypy
    """python-can's interface, but for what a tick cannot bear.

    That one reads a byte at a time, a millisecond for each that is not there; waits for the line to be empty after
    each write; and takes the answer to a command for "nothing more has come", so that frames pile up by one for each
    that is sent.

    Args:
        settings: python-can's: ``channel``, the serial port; ``bitrate`` of the bus; ``tty_baudrate``,
            ``sleep_after_open``.
    """

    def __init__(self, **settings: Any) -> None:
        self._begun = b""
        self._frames: deque[str] = deque()
        super().__init__(**{**settings, "timeout": 0.0})
        # As pyserial leaves it, a line on which nothing has come reads as one that has hung up.
        attributes = termios.tcgetattr(self.fileno())
        attributes[6][termios.VMIN] = 1
        termios.tcsetattr(self.fileno(), termios.TCSANOW, attributes)

    def _write(self, string: str) -> None:
        data = string.encode() + self.LINE_TERMINATOR
        try:
            if os.write(self.fileno(), data) < len(data):
                raise can.CanOperationError("the adapter is behind: a frame was cut")
        except OSError as error:
            raise can.CanOperationError(f"the adapter does not listen: {error.strerror}") from None

    def _read(self, timeout: float | None) -> str | None:
        if not self._frames:
            self._take()
        return self._frames.popleft() if self._frames else None

    def _take(self) -> None:
        """Read all that is there; what is left of a line that is not whole waits for the rest."""
        try:
            data = os.read(self.fileno(), _READ)
        except BlockingIOError:
            return
        except OSError as error:
            raise can.CanOperationError(f"the adapter is gone: {error.strerror}") from None
        if not data:
            raise can.CanOperationError("the adapter is gone")
        *lines, begun = (self._begun + data.translate(_ENDS)).split(b"\r")
        self._begun = begun[:_LONGEST]  # what goes on without an end is no adapter, and is not kept
        self._frames.extend(line.decode("ascii", "replace") for line in lines if line.startswith(_FRAMES))

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        try:
            message, is_filtered = super()._recv_internal(timeout)
        except (ValueError, IndexError, KeyError):
            raise can.CanOperationError("the adapter says what is no frame") from None
        return message, is_filtered

    def shutdown(self) -> None:
        """Close the bus and give the port up, also where the adapter has gone."""
        try:
            super().shutdown()
        finally:
            self.serialPortOrig.close()
