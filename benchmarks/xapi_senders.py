"""Attempts on their way to dead record stores, beside a rig: ``python benchmarks/xapi_senders.py``.

`trocar attempts xapi` is called again and again for a store that is not there, one that takes all and never answers,
and one that answers 503 to everything.
"""

from __future__ import annotations

import argparse
import socket
import subprocess
import sys
import tempfile
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import msgspec
from report import end_in_good_order

from trocar.review.attempts.assessment import Assessment, RigQuality
from trocar.review.attempts.store.attempts import Store

ATTEMPTS = 200


class _Busy(BaseHTTPRequestHandler):
    def do_POST(self) -> None:
        self.rfile.read(int(self.headers["Content-Length"]))
        self.send_error(503)

    def log_message(self, *_: object) -> None:
        """Say nothing."""


def make_database(file: Path) -> None:
    """Write a database with attempts of one trainee."""
    first = Assessment(
        attempt_id="0", scenario="insertion", title="Insertion", outcome="success", reason="", source="", began_ns=0,
        began_at_s=0.0, version="0", why_not=(), time_s=20.0, time_limit_s=90.0, goal_depth_m=0.02, depth_max_m=0.02,
        phases=[], errors=[], metrics={"path_m": 1.0}, limits={}, score=None, rig=RigQuality(),
    )  # fmt: skip
    with Store(str(file)) as store:
        for k in range(ATTEMPTS):
            each = msgspec.structs.replace(first, attempt_id=str(k), began_ns=(k + 1) * 10**11)
            store.add(each, "heron-17", file.with_name(f"{k}.mcap"))


def send_for_ever(port: int, database: Path, ended: threading.Event) -> None:
    """Send all attempts to a port of this host again and again; each time it fails."""
    options = ["attempts", "xapi", f"http://127.0.0.1:{port}/xapi/statements", "--database", str(database)]
    command = [sys.executable, "-c", "from trocar.services.cli.app import main; main()", *options]
    while not ended.is_set():
        with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as sender:
            while sender.poll() is None and not ended.wait(0.5):
                pass
            sender.terminate()


def main() -> None:
    """Send until killed."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    end_in_good_order()
    ended = threading.Event()
    with tempfile.TemporaryDirectory() as folder, socket.create_server(("127.0.0.1", 0)) as silent:
        with socket.create_server(("127.0.0.1", 0)) as free:
            nobody = free.getsockname()[1]
        busy = ThreadingHTTPServer(("127.0.0.1", 0), _Busy)
        threading.Thread(target=busy.serve_forever, daemon=True).start()
        make_database(database := Path(folder) / "attempts.sqlite")
        ports = nobody, silent.getsockname()[1], busy.server_port
        senders = [threading.Thread(target=send_for_ever, args=(port, database, ended)) for port in ports]
        for sender in senders:
            sender.start()
        try:
            for sender in senders:
                sender.join()
        finally:
            ended.set()
            for sender in senders:
                sender.join()
            busy.shutdown()
            busy.server_close()


if __name__ == "__main__":
    main()
