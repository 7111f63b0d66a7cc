"""The page's server: events, commands with a token, metrics, and whom it answers."""

from __future__ import annotations

import asyncio
import json
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import get_args

import httpx
import pytest
from prometheus_client.parser import text_string_to_metric_families
from starlette.applications import Starlette
from starlette.types import Message, Receive, Scope, Send

import trocar.protocol.bodies as bodies
from tests.supervisor.made_up import health, histogram, loop_report, rig
from trocar.protocol.topics import JUDGEMENT_S
from trocar.services.runtime.errors import BusError
from trocar.services.supervisor.control.commands import Command
from trocar.services.supervisor.judge.state_machine import RigState
from trocar.services.supervisor.page.metrics import Level, RigSource, registry
from trocar.services.supervisor.page.web import PageContext, build_app, stream_states


@dataclass
class Asked:
    commands: list[Command] = field(default_factory=list)

    def answer(self, command: Command) -> bodies.Answer:
        """Return what a supervisor says that obeys, and a training process that knows of `new` only."""
        self.commands.append(command)
        if command.order is None:
            return bodies.Answer(order=0, ok=True, text="done")
        match command.order.what:
            case "new":
                return bodies.Answer(order=command.order.id, ok=True, text="a new attempt begins")
            case "silence":
                raise BusError("the supervisor does not answer: nothing is done any more")
        return bodies.Answer(order=command.order.id, ok=False, text="there is no such order")


def _source() -> RigSource:
    path = bodies.PathLatency(name="device_model", latency=histogram([300_000] * 99 + [1_500_000]))
    topic = bodies.TopicReport(
        topic="gateway.state", received=100, dropped=2, refused={"flood": 3}, age=histogram([50_000] * 100)
    )
    heard = health(
        "haptics",
        loop=loop_report(1000, misses=7, skipped=3),
        paths=(path,),
        topics=(topic,),
        gauges={"dropped_contacts": 3.0},
    )
    processes = (
        bodies.ProcessReport(name="haptics", state="ready", restarts=2),
        bodies.ProcessReport(name="physics", state="lost"),
    )
    state = bodies.SupervisorState(state=RigState.DEGRADED, quality_level=1, processes=processes)
    return RigSource(state, {"haptics": heard})


@pytest.fixture
def asked() -> Asked:
    return Asked()


@pytest.fixture
def context(asked: Asked, tmp_path: Path) -> PageContext:
    return PageContext(
        rig=rig(),
        scene="default",
        registries={level: registry(_source, level) for level in get_args(Level)},
        ask=asked.answer,
        healthy=lambda: (True, "running"),
        view_port=lambda: 8081,
        dist=tmp_path / "dist",
        latest=b'{"state":"running"}',
    )


class Client:
    """Asks the application without a socket, one request at a time."""

    def __init__(self, app: Starlette) -> None:
        self._transport = httpx.ASGITransport(app)

    def ask(
        self, method: str, path: str, headers: dict[str, str] | None = None, content: bytes = b""
    ) -> httpx.Response:
        async def once() -> httpx.Response:
            async with httpx.AsyncClient(transport=self._transport, base_url="http://localhost:8080") as client:
                return await client.request(method, path, headers=headers, content=content)

        return asyncio.run(once())

    def get(self, path: str, headers: dict[str, str] | None = None) -> httpx.Response:
        return self.ask("GET", path, headers)

    def post(self, path: str, headers: dict[str, str] | None = None, content: bytes = b"") -> httpx.Response:
        return self.ask("POST", path, headers, content)


def _may(context: PageContext) -> dict[str, str]:
    return {"X-Trocar-Token": context.token, "X-Trocar-Before": "7 12.5"}


@pytest.fixture
def client(context: PageContext) -> Client:
    return Client(build_app(context))


def test_page_that_is_not_built_says_how_and_is_there_once_it_is(client: Client, context: PageContext) -> None:
    """Loaded again, as the page itself asked for, it still said so: it was looked for at the start only."""
    answer = client.get("/")
    assert answer.status_code == 503
    assert "python -m trocar.services.visualization.web.build" in answer.text
    assert client.get("/app.js").status_code == 404
    context.dist.mkdir()
    (context.dist / "index.html").write_text("<title>it is here</title>")
    (context.dist / "app.js").write_text("1")
    assert "it is here" in client.get("/").text
    assert client.get("/app.js").text == "1"


def test_page_that_is_built_is_served(context: PageContext) -> None:
    context.dist.mkdir()
    (context.dist.parent / "made_up.txt").write_text("not for the world")
    (context.dist / "index.html").write_text("<title>it is here</title>")
    (context.dist / "app.js").write_text("1")
    client = Client(build_app(context))
    assert "it is here" in client.get("/").text
    assert client.get("/app.js").text == "1"
    assert client.get("/%2e%2e/made_up.txt").status_code == 404
    assert client.get("/healthz").status_code == 200


def test_the_page_brings_the_rig_that_it_would_ask_for(context: PageContext) -> None:
    """The built document has a place for it; a name that would end the script there is a name still."""
    source = Path(__file__).resolve().parents[3] / "services" / "visualization" / "web" / "src" / "index.html"
    context.dist.mkdir()
    (context.dist / "index.html").write_text(source.read_text())
    context.scene = "</script><script>alert(1)</script>"
    client = Client(build_app(context))
    for path in ("/", "/index.html"):
        answer = client.get(path, headers={"Host": "[::1]:8080"})
        assert answer.headers["Cache-Control"] == "no-store"
        assert answer.text.count("<script") == source.read_text().count("<script")
        found = re.search(r'<script id="rig" type="application/json">(.*?)</script>', answer.text)
        assert found is not None
        assert json.loads(found[1]) == client.get("/api/rig", headers={"Host": "[::1]:8080"}).json()


def _policy(answer: httpx.Response) -> dict[str, str]:
    parts = (each.strip().partition(" ") for each in answer.headers["Content-Security-Policy"].split(";"))
    return {name: sources for name, _, sources in parts}


def test_every_answer_says_what_a_browser_may_do_with_it(client: Client, context: PageContext) -> None:
    """The page could be framed by any site, and ran what stood in it as well as what came with it."""
    context.dist.mkdir()
    (context.dist / "app.js").write_text("1")
    asked = ["/", "/app.js", "/nothing", "/api/rig", "/api/state", "/metrics", "/healthz"]
    answers = [client.get(path) for path in asked]
    (context.dist / "index.html").write_text("<title>it is here</title>")
    answers += [client.get("/"), client.post("/api/arm"), client.get("/", headers={"Host": "evil.example"})]
    for answer in answers:
        assert _policy(answer)["frame-ancestors"] == "'none'"
        assert "unsafe" not in answer.headers["Content-Security-Policy"]
        assert answer.headers["X-Content-Type-Options"] == "nosniff"
        assert answer.headers["Referrer-Policy"] == "no-referrer"


@pytest.mark.parametrize(
    ("host", "source"),
    [("localhost:8080", "ws://localhost:*"), ("192.168.1.11", "ws://192.168.1.11:*"), ("[::1]", "ws:")],
)
def test_the_page_connects_to_its_own_host_only(client: Client, context: PageContext, host: str, source: str) -> None:
    context.dist.mkdir()
    (context.dist / "index.html").write_text("<title>it is here</title>")
    policy = _policy(client.get("/", headers={"Host": host}))
    assert (policy["connect-src"], policy["default-src"]) == (f"'self' {source}", "'self'")


def test_rig_names_the_view_on_the_host_that_was_asked(client: Client) -> None:
    answer = client.get("/api/rig").json()
    assert answer["name"] == "made up"
    assert answer["view_ws"] == "ws://localhost:8081/ws"
    assert answer["token_needed"] is True
    through = client.get("/api/rig", headers={"Host": "[::1]:8080"}).json()
    assert through["view_ws"] == "ws://[::1]:8081/ws"


@pytest.mark.parametrize("command", ["arm", "safe_stop"])
def test_commands_need_the_token(client: Client, context: PageContext, asked: Asked, command: str) -> None:
    assert client.post(f"/api/{command}").status_code == 403
    assert client.post(f"/api/{command}", headers={"X-Trocar-Token": "guess"}).status_code == 403
    assert client.get(f"/api/{command}", headers={"X-Trocar-Token": context.token}).status_code == 404  # no file
    assert asked.commands == []
    answer = client.post(f"/api/{command}", headers=_may(context))
    assert (answer.status_code, answer.json()) == (200, {"ok": True, "text": "done"})
    (passed,) = asked.commands
    assert (passed.what, passed.incarnation, passed.before_s) == (command, 7, 12.5)


@pytest.mark.parametrize("before", ["", "7", "7 inf", "7 nan", "7 -1", "7 1e9", f"{'9' * 30} 1", "7 1 1"])
def test_a_command_says_up_to_when_it_is_wanted(
    client: Client, context: PageContext, asked: Asked, before: str
) -> None:
    answer = client.post("/api/arm", headers=_may(context) | {"X-Trocar-Before": before})
    assert answer.status_code == 400
    assert "X-Trocar-Before" in answer.json()["error"]
    assert asked.commands == []


@pytest.mark.parametrize("host", ["evil.example", "evil.example:8080", "127.0.0.1.evil.example", ""])
def test_another_sites_name_for_this_machine_is_refused(
    client: Client, context: PageContext, asked: Asked, host: str
) -> None:
    answer = client.post("/api/arm", headers={"Host": host, "X-Trocar-Token": context.token})
    assert answer.status_code == 421
    assert asked.commands == []


@pytest.mark.parametrize("host", ["127.0.0.1:8080", "LOCALHOST", "192.168.1.7:8080", "[::1]:8080", "rig.localhost"])
def test_this_machines_names_are_known(client: Client, host: str) -> None:
    assert client.get("/healthz", headers={"Host": host}).status_code == 200


def test_healthz_follows_the_rig(client: Client, context: PageContext) -> None:
    context.healthy = lambda: (False, "safe_stop: because")
    answer = client.get("/healthz")
    assert answer.status_code == 503
    assert answer.json() == {"ok": False, "state": "safe_stop: because"}


def test_events_carry_the_newest_state_only(context: PageContext) -> None:
    """A client that was away for many states gets the newest one; the stream ends with the page."""

    async def read() -> list[str]:
        states = []
        told, app = asyncio.Semaphore(0), build_app(context)

        async def overheard(scope: Scope, receive: Receive, send: Send) -> None:
            async def pass_on(message: Message) -> None:
                await send(message)
                if b"event: state" in message.get("body", b""):
                    told.release()

            await app(scope, receive, pass_on)

        transport = httpx.ASGITransport(overheard)
        context.latest = b'{"n":1}'

        async def later() -> None:
            for n in (2, 3, 4):
                context.latest = json.dumps({"n": n}).encode()
            for _ in range(2):
                await told.acquire()
            context.closing = True

        task = asyncio.create_task(later())
        async with httpx.AsyncClient(transport=transport, base_url="http://localhost") as client:
            answer = await client.get("/events")
        await task
        assert answer.headers["content-type"].startswith("text/event-stream")
        for block in answer.text.strip().split("\n\n"):
            lines = block.split("\n")
            if lines[0] == "event: state":
                states.append(lines[1].removeprefix("data: "))
        return states

    states = asyncio.run(read())
    assert states[0] == '{"n": 4}'
    assert set(states) == {'{"n": 4}'}


def test_no_state_is_told_before_the_supervisor_has_said_anything(client: Client, context: PageContext) -> None:
    """Readers of the first state found an empty object, in which nothing was that they read."""
    context.latest = b""

    async def first() -> bytes:
        stream = stream_states(context)
        assert await anext(stream) == b"retry: 1000\n\n"
        told = asyncio.create_task(anext(stream))
        await asyncio.sleep(2.5 * JUDGEMENT_S)
        assert not told.done()
        context.latest = b'{"n": 1}'
        return await told

    silent = client.get("/api/state")
    assert (silent.status_code, silent.json()) == (503, {"error": "the supervisor has said nothing yet"})
    assert asyncio.run(first()) == b'event: state\ndata: {"n": 1}\n\n'
    assert client.get("/api/state").json() == {"n": 1}


def test_metrics_are_what_prometheus_reads(client: Client) -> None:
    text = client.get("/metrics?level=full").text
    families = {family.name: family for family in text_string_to_metric_families(text)}
    for name in (
        "trocar_loop_lateness_seconds", "trocar_loop_period_seconds", "trocar_loop_work_seconds",
        "trocar_loop_iterations", "trocar_deadline_misses", "trocar_path_latency_seconds", "trocar_topic_age_seconds",
        "trocar_topic_messages", "trocar_topic_drops", "trocar_service_up",
        "trocar_service_restarts", "trocar_device_link_up", "trocar_build_info",
    ):  # fmt: skip
        assert name in families, name
    value = {
        (sample.name, tuple(sorted(sample.labels.items()))): sample.value
        for family in families.values()
        for sample in family.samples
    }
    assert value["trocar_deadline_misses_total", (("loop", "haptics"),)] == 7
    assert value["trocar_loop_iterations_total", (("loop", "haptics"),)] == 1000
    states = {dict(labels)["state"]: v for (name, labels), v in value.items() if name == "trocar_rig_state"}
    assert [state for state, is_in in states.items() if is_in] == ["degraded"]
    assert len(states) == 6
    seconds = value["trocar_path_latency_seconds_sum", (("path", "device_model"),)]
    assert seconds == pytest.approx(99 * 300e-6 + 1.5e-3)
    assert value["trocar_service_restarts_total", (("service", "haptics"),)] == 2
    assert value["trocar_service_up", (("service", "physics"),)] == 0
    assert value["trocar_service_uptime_seconds", (("service", "haptics"),)] == 1.0
    assert value["trocar_gauge", (("name", "dropped_contacts"), ("service", "haptics"))] == 3
    drops = {labels: v for (name, labels), v in value.items() if name == "trocar_topic_drops_total"}
    assert sorted(drops.values()) == [2, 3]


def test_the_deadline_is_an_edge_so_miss_ratios_are_exact(client: Client) -> None:
    text = client.get("/metrics?level=full").text
    family = next(f for f in text_string_to_metric_families(text) if f.name == "trocar_path_latency_seconds")
    buckets = {s.labels["le"]: s.value for s in family.samples if s.name.endswith("_bucket")}
    assert buckets["0.001"] == 99
    assert buckets["+Inf"] == 100
    ordered = [count for _, count in sorted(buckets.items(), key=lambda item: float(item[0]))]
    assert ordered == sorted(ordered)


def test_an_order_of_the_attempt_is_answered_by_who_carries_it_out(
    client: Client, context: PageContext, asked: Asked
) -> None:
    token = _may(context)
    order = b'{"what": "new", "value": 0.5}'
    assert client.post("/api/attempt", content=order).status_code == 403
    assert asked.commands == []
    done = client.post("/api/attempt", token, order)
    assert (done.status_code, done.json()) == (200, {"ok": True, "text": "a new attempt begins"})
    first = asked.commands[0].order
    assert first is not None
    assert (first.what, first.value) == ("new", 0.5)
    refused = client.post("/api/attempt", token, b'{"what": "dance"}')
    assert (refused.status_code, refused.json()) == (409, {"error": "there is no such order"})
    late = client.post("/api/attempt", token, b'{"what": "silence"}')
    assert late.status_code == 504
    assert "nothing is done any more" in late.json()["error"]


@pytest.mark.parametrize(
    "content", [b"", b"[1]", b'{"what": 1}', b'{"what": "new", "value": -1}', b'{"what": "new", "x": 1}', b"9" * 5000]
)
def test_an_order_that_cannot_be_read_is_refused_with_a_sentence(
    client: Client, context: PageContext, asked: Asked, content: bytes
) -> None:
    answer = client.post("/api/attempt", _may(context), content)
    assert answer.status_code == 400
    assert answer.json()["error"].startswith("the order cannot be read: ")
    assert asked.commands == []


def test_a_recording_that_is_shown_is_moved_without_a_token_and_from_this_page_only(
    context: PageContext, asked: Asked
) -> None:
    """A replay of pictures moves no arm; the link of a report carries no token."""
    own = {"X-Trocar-Replay": "1"}
    assert Client(build_app(context)).post("/api/replay", own, b"@3").status_code == 409
    context.replays = lambda: True
    client = Client(build_app(context))
    assert client.post("/api/replay", own, b"@3").json()["ok"]
    assert client.post("/api/replay", {}, b"@4").status_code == 403
    client.post("/api/replay", own, b"@" + b"5" * 5000)
    assert [each.line for each in asked.commands] == ["@3", "@" + 31 * "5"]


def test_a_rig_that_nobody_begins_anew_is_not_switched(context: PageContext, asked: Asked) -> None:
    """One of compose, or a replay: its processes are not this supervisor's to end."""
    token, client = _may(context), Client(build_app(context))
    assert client.get("/api/rig").json()["switches"] is False
    assert "trocar up" in client.post("/api/scenario", token, b"narrow").json()["error"]
    context.switches = True
    assert client.post("/api/scenario", token, b"narrow" * 1000).status_code == 400
    assert client.post("/api/scenario", {}, b"narrow").status_code == 403
    assert asked.commands == []
    assert client.post("/api/scenario", token, b"narrow").status_code == 200
    assert [each.line for each in asked.commands] == ["narrow"]


def test_a_rig_goes_on_from_a_moment_of_a_recording_that_is_its_own(
    context: PageContext, asked: Asked, tmp_path: Path
) -> None:
    context.rig = context.rig.model_copy(
        update={"recorder": context.rig.recorder.model_copy(update={"directory": tmp_path})}
    )
    (tmp_path / "one.mcap").write_bytes(b"")
    context.switches, token = True, _may(context)
    client = Client(build_app(context))
    for line, status in ((b"../one.mcap 5 basic", 400), (b"one.mcap 5 nothing", 400), (b"two.mcap 5 basic", 409)):
        assert client.post("/api/take_over", token, line).status_code == status
    assert client.post("/api/take_over", {}, b"one.mcap 5 basic").status_code == 403
    assert asked.commands == []
    assert client.post("/api/take_over", token, b"one.mcap 5 basic").status_code == 200
    assert [(each.what, each.line) for each in asked.commands] == [("take_over", "one.mcap 5 basic")]


def test_only_an_instructor_begins_the_rig_anew(context: PageContext, asked: Asked) -> None:
    context.class_token = "of the class"
    instructor = {**_may(context), "X-Trocar-Token": context.class_token}
    client = Client(build_app(context))
    assert client.post("/api/restart", instructor).status_code == 409, "it was not started by `trocar up`"
    context.switches = True
    for other in ({}, _may(context)):
        assert client.post("/api/restart", other).status_code == 403
    assert asked.commands == []
    assert client.post("/api/restart", instructor).status_code == 200
    assert [each.what for each in asked.commands] == ["restart"]
