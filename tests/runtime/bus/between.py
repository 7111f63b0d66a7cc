"""Somebody between a publisher and a reader."""

from __future__ import annotations

import socket
import threading
import time
from contextlib import suppress


class Between:
    """Passes on what comes for a port, from a `shift` higher, `delay_s` late; says twice what it `repeats`.

    It keeps what publisher and reader `said`, and may play the publisher's to whoever connects anew.
    """

    shift = 500

    def __init__(self, port: int) -> None:
        self.repeats, self.plays, self.delay_s = False, False, 0.0
        self.said = {"publisher": b"", "reader": b""}
        self._listener = socket.create_server(("127.0.0.1", port + self.shift))
        self._port = port
        self._open = [self._listener]
        self._accepting = threading.Thread(target=self._accept, daemon=True)
        self._accepting.start()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                reader = self._listener.accept()[0]
                self._open.append(reader)
                if self.plays:
                    with suppress(OSError):
                        reader.sendall(self.said["publisher"])
                    continue
                sender = socket.create_connection(("127.0.0.1", self._port))
                self._open.append(sender)
                for source, sink, back in ((reader, sender, False), (sender, reader, True)):
                    threading.Thread(target=self._pass, args=(source, sink, back), daemon=True).start()

    def _pass(self, source: socket.socket, sink: socket.socket, back: bool) -> None:
        with suppress(OSError):
            while data := source.recv(1 << 16):
                time.sleep(self.delay_s)
                self.said["publisher" if back else "reader"] += data
                sink.sendall(data * (2 if back and self.repeats else 1))
        for each in (source, sink):
            with suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)

    def part(self) -> None:
        """Part those who are connected, who may connect again."""
        for each in self._open[1:]:
            with suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """Part both ends, whoever has just come among them."""
        self._listener.shutdown(socket.SHUT_RDWR)
        self._accepting.join()
        for each in self._open:
            with suppress(OSError):  # one that is waited at is closed when the wait is over
                each.shutdown(socket.SHUT_RDWR)
            each.close()
