"""The view's server over a real socket: newest frames to every client, nothing that a client says can hurt it."""

import hashlib
import json
import logging
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import httpx
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from tests.patience import PATIENCE_S
from tests.visualization.test_view_codec import a_layout, a_picture
from trocar.protocol import bodies
from trocar.services.runtime.config.rig import ViewSettings
from trocar.services.runtime.errors import UserError
from trocar.services.runtime.measures.histogram import LatencyHistogram
from trocar.services.runtime.process.health import LatencyPath
from trocar.services.runtime.web.web_certificate import Certificate
from trocar.services.visualization import codec
from trocar.services.visualization.feed import IN_FLIGHT
from trocar.services.visualization.outputs import WebOutput
from trocar.services.visualization.page_hands import PageHands
from trocar.services.visualization.picture import Picture
from trocar.services.visualization.server import may_look

TOKEN = "what trocar up printed"
LOG = logging.getLogger("test")


def nobodys_hands(published: list[bodies.Hands] | None = None, *followers: str) -> PageHands:
    token = hashlib.sha256(TOKEN.encode()).hexdigest()
    return PageHands(followers, ([] if published is None else published).append, lambda: None, lambda: token)


class Show:
    """An output that shows a picture every few milliseconds in a thread of its own, as the process does in its loop."""

    def __init__(self, period_s: float = 4e-3, certificate: Certificate | None = None) -> None:
        self._certificate = certificate
        self.notice = '{"type": "rig"}'
        self._period_ns = round(1e9 * period_s)
        self.path = LatencyPath(LatencyHistogram(33_000_000))
        self.layout = a_layout()
        self.picture = a_picture(self.layout)
        self.ready, self._stop = threading.Event(), threading.Event()
        self.published: list[bodies.Hands] = []
        self.hands = nobodys_hands(self.published, "left")
        self.port, self.shown, self.clients = 0, 0, 0.0
        self.wanted_hz: float | None = None
        self._thread = threading.Thread(target=self._run)

    def __enter__(self) -> "Show":
        self._thread.start()
        assert self.ready.wait(PATIENCE_S)
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        output = WebOutput(ViewSettings(port=0), self.path, LOG, self.hands, self._certificate)
        self.port = int(output.gauges()["view_port"])
        while not self._stop.is_set():
            self.shown += 1
            picture = replace(
                self.picture,
                epoch=self.layout.epoch,
                sequence=self.shown,
                tick=self.shown,
                origin_ns=time.monotonic_ns(),
                inserted_length_m=0.0,
            )
            output.show(self.layout, picture, self.notice)
            output.wait_until(time.monotonic_ns() + self._period_ns)
            self.clients = output.gauges()["clients"]
            self.wanted_hz = output.wanted_hz()
            self.ready.set()
        output.close()

    def connect(self, path: str = "ws", **options: object) -> ClientConnection:
        return connect(f"ws://127.0.0.1:{self.port}/{path}", compression=None, **options)


@pytest.fixture
def show() -> Iterator[Show]:
    with Show() as running:
        yield running


def frame_of(client: ClientConnection, show: Show) -> Picture:
    while True:
        message = client.recv(timeout=PATIENCE_S)
        if isinstance(message, bytes):
            return codec.decode(message, show.layout)[0]


def echo(client: ClientConnection, picture: Picture) -> None:
    client.send(struct.pack("<Q", picture.sequence))


def test_a_client_gets_state_hello_and_then_frames(show):
    with show.connect() as client:
        assert client.recv(timeout=PATIENCE_S) == '{"type": "rig"}'
        assert codec.decode_hello(client.recv(timeout=PATIENCE_S)).scene == "test"
        last = 0
        for _ in range(20):
            picture = frame_of(client, show)
            assert picture.sequence > last
            last = picture.sequence
            echo(client, picture)
    assert show.path.latency.total > 0


def test_a_slow_client_wakes_to_the_newest_frame_and_does_not_slow_a_fast_one(show):
    with show.connect() as slow, show.connect() as fast:
        for _ in range(60):
            echo(fast, frame_of(fast, show))
        waiting = [frame_of(slow, show) for _ in range(IN_FLIGHT)]
        with pytest.raises(TimeoutError):
            slow.recv(timeout=0.2)
        before = show.shown
        echo(slow, waiting[-1])
        assert frame_of(slow, show).sequence >= before - 1


def test_nonsense_from_a_client_is_ignored(show):
    with show.connect() as client:
        for nonsense in ("hello", b"", b"123", b"\xff" * 8, b"x" * 900, "\0"):
            client.send(nonsense)
        for _ in range(10):
            echo(client, frame_of(client, show))


def test_a_client_that_sends_too_much_is_closed_and_the_others_stay(show):
    with show.connect() as good, show.connect() as bad:
        bad.send(b"x" * 5000)
        with pytest.raises(ConnectionClosed):
            list(bad)
        echo(good, frame_of(good, show))
        frame_of(good, show)


def test_a_client_that_vanishes_is_forgotten(show):
    with show.connect() as client:
        frame_of(client, show)
        clients_become(show, 1)
        client.socket.shutdown(socket.SHUT_RDWR)  # no closing handshake
    clients_become(show, 0)


def clients_become(show: Show, count: int) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while show.clients != count and time.monotonic() < deadline:
        time.sleep(0.01)
    assert show.clients == count


def test_a_page_of_another_site_may_not_look(show):
    with pytest.raises(InvalidStatus):
        show.connect(origin="http://elsewhere.example")
    with show.connect(origin="http://127.0.0.1:8080") as client:
        frame_of(client, show)


def test_origins():
    here = socket.gethostname().lower()
    assert may_look(None, f"{here}:8081")
    assert may_look(f"http://{here}:8080", f"{here}:8081")
    assert may_look("http://localhost:8080", "localhost:8081")
    assert may_look("http://[::1]:8080", "[::1]:8081")
    assert not may_look("http://elsewhere.example", "127.0.0.1:8081")
    assert not may_look("http://elsewhere.example", "elsewhere.example:8081")  # rebinding
    assert not may_look("null", "127.0.0.1:8081")
    assert not may_look("http://127.0.0.1", None)


@pytest.mark.parametrize("path", ["snapshot.png", "camera.mjpeg"])
def test_a_picture_is_not_given_to_another_sites_name_for_this_machine(show, path):
    answer = httpx.get(f"http://127.0.0.1:{show.port}/{path}", headers={"Host": "evil.example"}, timeout=PATIENCE_S)
    assert answer.status_code == 421
    assert "not known here" in answer.text


def test_a_picture_is_drawn_on_this_host_for_whoever_cannot_draw(show):
    """By a process of its own, which begins with the first that is asked for: a busy machine may take long for that."""
    until_s = time.monotonic() + PATIENCE_S
    while (answer := httpx.get(f"http://127.0.0.1:{show.port}/snapshot.png", timeout=PATIENCE_S)).status_code != 200:
        assert time.monotonic() < until_s, answer.text
    assert answer.content.startswith(b"\x89PNG")


def test_the_server_says_that_it_lives(show):
    assert httpx.get(f"http://127.0.0.1:{show.port}/healthz", timeout=PATIENCE_S).text == "ok\n"


def test_a_port_that_is_taken_is_one_sentence():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        settings = ViewSettings(port=taken.getsockname()[1])
        with pytest.raises(UserError, match=r"cannot listen on 127.*: address already .* visualization\.port=N"):
            WebOutput(settings, LatencyPath(LatencyHistogram(1)), LOG, nobodys_hands())


def test_hands_reach_the_rig_with_the_token_and_one_that_speaks_bytes_is_let_go(show):
    with show.connect("hands") as page:
        page.send(TOKEN)
        assert json.loads(page.recv(timeout=PATIENCE_S))["type"] == "hands"
        page.send('[[["left",[0.01,0.02,0.03],0.5,1.0]]]')
        deadline = time.monotonic() + PATIENCE_S
        while not show.published and time.monotonic() < deadline:
            time.sleep(0.01)
        assert show.published[0].hands[0].position_m == (0.01, 0.02, 0.03)
        page.send(b"\x00")
        with pytest.raises(ConnectionClosed):
            page.recv(timeout=PATIENCE_S)
    with show.connect("hands") as stranger:
        stranger.send("guess")
        with pytest.raises(ConnectionClosed) as caught:
            stranger.recv(timeout=PATIENCE_S)
        assert "token" in caught.value.rcvd.reason
    with pytest.raises((ConnectionClosed, InvalidStatus)), show.connect("hands", origin="http://evil.example") as page:
        page.recv(timeout=PATIENCE_S)


def test_a_client_that_asks_for_fewer_pictures_is_sent_fewer_and_the_process_is_told(show: Show):
    with show.connect() as client:
        frame_of(client, show)
        client.send('{"type": "want", "pictures_hz": 20}')
        eventually(lambda: show.wanted_hz == 20.0)
        began, got = time.monotonic(), 0
        while got < 40:
            client.send(struct.pack("<Q", frame_of(client, show).sequence))
            got += 1
        assert time.monotonic() - began > (got - 4) / 20.0, "but for those that were on their way"
        client.send('{"type": "want", "pictures_hz": null}')
        eventually(lambda: show.wanted_hz is None)
    eventually(lambda: show.clients == 0)


@pytest.mark.parametrize(
    "nonsense",
    ["", "{", "[]", '{"type": "want"}', '{"type": "want", "pictures_hz": 0}', '{"type": "want", "pictures_hz": -1}',
     '{"type": "want", "pictures_hz": "15"}', '{"type": "want", "pictures_hz": 1e999}',
     '{"type": "other", "pictures_hz": 15}', "9" * 900],
)  # fmt: skip
def test_a_wish_that_makes_no_sense_is_ignored(show: Show, nonsense: str):
    with show.connect() as client:
        frame_of(client, show)
        client.send(nonsense)
        for _ in range(3):
            client.send(struct.pack("<Q", frame_of(client, show).sequence))
        assert show.wanted_hz is None


def eventually(condition: Callable[[], bool], seconds: float = PATIENCE_S) -> None:
    until = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < until, "it did not happen"
        time.sleep(0.01)
