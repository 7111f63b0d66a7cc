"""CAN adapters on a serial line with the slcan protocol (Lawicel), read and written without waiting."""

from __future__ import annotations

import os
import termios
from collections import deque
from typing import Any

import can
from can.interfaces.slcan import slcanBus

#: Initial letters of frames; other lines answer commands: "z" for each frame sent, an empty line, a bell for an error.
_FRAMES = (b"t", b"T", b"r", b"R")
_ENDS = bytes.maketrans(b"\a\n", b"\r\r")
#: Answers to commands and to frames that were sent.
_ANSWERS = (b"", b"z", b"Z")
_READ = 4096  # all that Linux keeps of a serial line's input
#: Longest line: twice a frame of eight bytes, which has 26 characters and four of a time stamp.
_LONGEST = 64


class SlcanBus(slcanBus):  # type: ignore[misc]  # python-can is not read by mypy
    """python-can's interface, without its waiting.

    python-can's own reads single bytes, waiting a millisecond for each missing one; waits for the line to drain after
    each write; and takes the answer to a command for the end of the input, so that one frame is left over for each
    frame sent.

    Attributes:
        strange: int. Number of lines so far that are neither a frame nor an answer.

    Args:
        settings: Those of python-can: ``channel``, the serial port; ``bitrate`` of the bus; ``tty_baudrate``,
            ``sleep_after_open``.
    """

    def __init__(self, **settings: Any) -> None:
        self._begun = b""
        self.strange = 0
        self._frames: deque[str] = deque()
        super().__init__(**{**settings, "timeout": 0.0})
        # With pyserial's settings, a line without input could not be told from a closed one.
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
            self._take_input()
        return self._frames.popleft() if self._frames else None

    def _take_input(self) -> None:
        """Read all available input, and keep an incomplete line for later."""
        try:
            data = os.read(self.fileno(), _READ)
        except BlockingIOError:
            return
        except OSError as error:
            raise can.CanOperationError(f"the adapter is gone: {error.strerror}") from None
        if not data:
            raise can.CanOperationError("the adapter is gone")
        *lines, begun = (self._begun + data.translate(_ENDS)).split(b"\r")
        self.strange += len(begun) > _LONGEST  # an endless line is not from an adapter
        self._begun = begun[:_LONGEST]
        for line in map(bytes.strip, lines):
            if line.startswith(_FRAMES):
                self._frames.append(line.decode("ascii", "replace"))
            else:
                self.strange += line not in _ANSWERS

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        try:
            message, is_filtered = super()._recv_internal(timeout)
        except (ValueError, IndexError, KeyError):
            self.strange += 1
            raise can.CanOperationError("the adapter says what is no frame") from None
        return message, is_filtered

    def shutdown(self) -> None:
        """Close the bus and the port, even of a lost adapter."""
        try:
            super().shutdown()
        finally:
            self.serialPortOrig.close()
