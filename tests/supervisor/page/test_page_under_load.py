"""The page's server against who does not read, ten who do, a storm of reloads, nonsense and wrong tokens."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from tests.patience import PATIENCE_S
from tests.review.class_of_pages import page, served, until
from trocar.services.supervisor.control.commands import Command
from trocar.services.supervisor.page import web
from trocar.services.supervisor.page.web import PageContext, build_app

#: More than the buffers of a socket hold after a few.
_STATE = b'{"state":"running","padding":"' + b"x" * (1 << 20) + b'"}'


class Counting:
    """Counts how often the state was taken by whoever sends it."""

    def __init__(self) -> None:
        self.taken = 0

    def __radd__(self, other: bytes) -> bytes:
        self.taken += 1
        return other + _STATE


@pytest.fixture
def context(monkeypatch: pytest.MonkeyPatch) -> PageContext:
    monkeypatch.setattr(web, "JUDGEMENT_S", 0.005)
    return page()


@pytest.fixture
def address(context: PageContext) -> Iterator[httpx.URL]:
    with served(build_app(context)) as [address]:
        yield httpx.URL(address)
        context.closing = True


def _call(address: httpx.URL, text: str) -> socket.socket:
    made = socket.create_connection((address.host, address.port or 0), timeout=PATIENCE_S)
    try:
        made.sendall(text.encode("latin-1"))
    except OSError:  # refused before all of it was sent
        made.close()
        raise
    return made


def _watch(address: httpx.URL) -> socket.socket:
    return _call(address, "GET /events HTTP/1.1\r\nHost: localhost\r\n\r\n")


def test_a_client_that_stops_reading_is_sent_no_more_and_the_others_go_on(
    address: httpx.URL, context: PageContext
) -> None:
    counting = Counting()
    context.latest = counting  # type: ignore[assignment]
    with _watch(address):
        until(lambda: counting.taken > 0, "it was sent something")
        until(lambda: _rests(counting), "nothing more is made for who does not read")
        assert counting.taken < 32  # of a megabyte each: what the buffers of a socket may hold
        with httpx.stream("GET", address.join("/events"), timeout=PATIENCE_S) as other:
            states = (line for line in other.iter_lines() if line.startswith("event: state"))
            for _ in range(5):
                assert next(states) == "event: state"


def _rests(counting: Counting) -> bool:
    """Return whether nobody took a state while another request was answered a hundred periods long."""
    before = counting.taken
    threading.Event().wait(0.5)
    return counting.taken == before


def test_ten_viewers_all_get_the_newest_state(address: httpx.URL, context: PageContext) -> None:
    viewers = [_watch(address) for _ in range(10)]
    try:
        context.latest = b'{"n": "the newest"}'
        for viewer in viewers:
            seen = b""
            while b"the newest" not in seen:
                part = viewer.recv(1 << 16)
                assert part, "the page has closed"
                seen = seen[-64:] + part
    finally:
        for viewer in viewers:
            viewer.close()


def test_a_storm_of_reloads_leaves_nothing_behind(address: httpx.URL) -> None:
    """A reload closes the stream of before, often in the middle of an answer."""
    before = {thread.ident for thread in threading.enumerate()}
    for turn in range(100):
        with _watch(address) as viewer:
            if turn % 2:
                viewer.recv(100)
    assert httpx.get(address.join("/healthz"), timeout=PATIENCE_S).status_code == 200
    until(lambda: _streams(address) == 0, "every stream has ended")
    assert {thread.ident for thread in threading.enumerate()} <= before


def _streams(address: httpx.URL) -> int:
    """Return how many connections to the page are open at the server's end."""
    port = f":{address.port:04X}"
    rows = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    return sum(row[1].endswith(port) and row[3] in ("01", "08") for row in rows)


@pytest.mark.parametrize(
    "nonsense",
    [
        "\x00\xff" * 500, "GET\r\n\r\n", "GET /events HTTP/9.9\r\n\r\n",
        "POST /api/arm HTTP/1.1\r\nHost: localhost\r\n\r\n",
        "POST /api/attempt HTTP/1.1\r\nHost: localhost\r\nContent-Length: -5\r\n\r\n",
        "GET / HTTP/1.1\r\nHost: localhost\r\n" + "X: " + "y" * (1 << 20) + "\r\n\r\n",
        "GET /" + "a" * (1 << 20) + " HTTP/1.1\r\nHost: localhost\r\n\r\n",
        "GET /metrics?level=everything HTTP/1.1\r\nHost: localhost\r\n\r\n",
    ],
    ids=range(8),
)  # fmt: skip
def test_nonsense_is_refused_and_who_comes_next_is_answered(address: httpx.URL, nonsense: str) -> None:
    try:
        with _call(address, nonsense) as caller:
            answer = caller.recv(64)
    except (ConnectionResetError, BrokenPipeError):
        answer = b""  # refused before all of it was read
    assert not answer.startswith(b"HTTP/1.1 2")
    assert httpx.get(address.join("/healthz"), timeout=PATIENCE_S).status_code == 200


def test_every_wrong_token_is_refused(address: httpx.URL, context: PageContext) -> None:
    acted: list[Command] = []
    context.ask = acted.append
    with httpx.Client(timeout=PATIENCE_S) as client:
        for turn in range(300):
            answer = client.post(address.join("/api/arm"), headers={"X-Trocar-Token": f"guess {turn}"})
            assert answer.status_code == 403
    assert acted == []
