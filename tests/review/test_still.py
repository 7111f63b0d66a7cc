"""The cholangiogram of an attempt's end: from a recording, by a process of its own, kept and forgotten."""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Iterator
from pathlib import Path

import httpx
import msgspec
import numpy as np
import pytest
import yaml

from tests.memory_bus import MemoryBus
from tests.patience import PATIENCE_S
from tests.physics.conftest import SMALL, Rig, let_time_pass
from tests.review.benches import made_up
from tests.review.class_of_pages import served
from trocar.protocol.topics import TICK_S
from trocar.review.attempts.assessment import Assessment
from trocar.review.attempts.report import DEFAULT_PAGE
from trocar.review.commands.report import ReportRequest, run_report
from trocar.review.export.png import grey_png
from trocar.review.export.still import INJECTED_S, SIZE, Moment, last_frames, still_of
from trocar.review.school import stills
from trocar.review.school.app import ROLE, build_app
from trocar.review.school.bench import Bench
from trocar.services.recorder.recording import RecordingWriter
from trocar.services.recordings.errors import RecordingError
from trocar.services.recordings.reader import read_messages
from trocar.services.runtime.config import config
from trocar.services.training.scenario import load_scenario
from trocar.services.training.situation import TISSUES

TICKS, FIRST_TICK = 400, 100
LATE_M3 = 0.98 * INJECTED_S * 0.25e-6
IN_IT = (
    "catheter.tip_position_m=[0.03, 0.0, 0.0]",
    "effects.gallstones={position_m: [[0.02, 0.0, -0.001]], radius_m: [0.0015]}",
    f"catheter.bubbles=[{{radius_m: 0.0012}}, {{radius_m: 0.0008, after_m3: {LATE_M3}}}]",
)
OUTSIDE = ("catheter.tip_position_m=[0.045, 0.0, 0.0]",)


def record(path: Path, *overrides: str) -> Path:
    """Record some ticks of a rig whose hands do nothing; its scene is changed by these."""
    rig, topics = Rig(*overrides), ("gateway.state", "physics.state")
    listener, frames = MemoryBus(rig.hub, reads_every=topics), []
    for _ in range(TICKS):
        rig.turn((0.02, -0.05, 0.08), (0.02, 0.05, 0.08))
        frames += [each for name in topics for each in listener.drain(name)]
    writer = RecordingWriter(path, {"scene": "small"})
    writer.attach("scene.yaml", "application/yaml", yaml.safe_dump(config.read_scene(SMALL, list(overrides))).encode())
    for each in sorted(frames, key=lambda each: each.sent_ns):
        writer.write(each)
    writer.close()
    return path


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("recorded")
    with pytest.MonkeyPatch.context() as patch:
        let_time_pass(patch)
        return {"in it": record(folder / "in.mcap", *IN_IT), "outside": record(folder / "out.mcap", *OUTSIDE)}


def attempt(recording: Path, scenario: str, time_s: float = 0.3) -> Assessment:
    """An attempt that began at a tick of a recording and ended in it."""
    ticks = ((time_ns, body.tick) for _, time_ns, body in read_messages(recording, ["gateway.state"]))
    began_ns = next(time_ns for time_ns, tick in ticks if tick == FIRST_TICK)
    return msgspec.structs.replace(
        made_up("a"), scenario=scenario, began_ns=began_ns, time_s=time_s, from_tick=FIRST_TICK, source=recording.name,
        limits=dict.fromkeys(TISSUES, 1.0), metrics={"time_s": time_s, "deepest_m": 0.0, "grasps": 0.0},
    )  # fmt: skip


def end_of(recording: Path, time_s: float = 0.2) -> Moment:
    began_ns = attempt(recording, "basic").began_ns
    return Moment(tick=FIRST_TICK + round(time_s / TICK_S), time_ns=began_ns + round(time_s * 1e9))


def pixels(png: bytes) -> np.ndarray:
    """Read what `grey_png` has written."""
    assert png[:8] == b"\x89PNG\r\n\x1a\n"
    width, height = (int.from_bytes(png[at : at + 4], "big") for at in (16, 20))
    at = png.index(b"IDAT")
    data = zlib.decompress(png[at + 4 : at + 4 + int.from_bytes(png[at - 4 : at], "big")])
    rows = np.frombuffer(data, np.uint8).reshape(height, width + 1)
    assert not rows[:, 0].any()
    return rows[:, 1:]


def test_a_grey_picture_is_the_same_when_it_is_read() -> None:
    grey = np.random.default_rng(1).integers(0, 256, (31, 47)).astype(np.uint8)
    np.testing.assert_array_equal(pixels(grey_png(grey)), grey)


def test_the_still_shows_stone_and_bubble_and_what_comes_back(recordings: dict[str, Path]) -> None:
    still = still_of(recordings["in it"], end_of(recordings["in it"]))
    reaches, back, *gaps, flushed = still.words
    assert flushed == "1 bubble of air was flushed out."
    assert reaches == "Agent reaches the common duct."
    share = float(back.removesuffix(" % of the agent comes back through the mouth."))
    assert 50.0 < share < 100.0, "to the mouth it is 10 mm, beside the catheter, to the common duct 30 mm"
    (stone,) = [each for each in gaps if each.endswith("a stone.")]
    assert stone == "A gap of 3.0 mm, 20 mm from the mouth: a stone."
    (bubble,) = [each for each in gaps if each.endswith("a bubble of air.")]
    assert bubble.startswith("A gap of 1.6 mm, ")
    assert pixels(base64.b64decode(still.image)).shape == SIZE[::-1]


def test_a_tip_that_is_outside_brings_no_agent(recordings: dict[str, Path]) -> None:
    still = still_of(recordings["outside"], end_of(recordings["outside"]))
    assert still.words == ["No agent comes into the duct: the tip is outside."]


def test_a_recording_that_ends_before_the_attempt_is_said(recordings: dict[str, Path]) -> None:
    with pytest.raises(RecordingError, match=r"in.mcap: does not hold the end of the attempt, or not yet"):
        still_of(recordings["in it"], end_of(recordings["in it"], 100.0))


@pytest.mark.parametrize("knows_ticks", [True, False])
def test_it_is_that_of_the_end_and_of_no_later_moment(recordings: dict[str, Path], knows_ticks: bool) -> None:
    path = recordings["in it"]
    end = end_of(path, 0.2)
    if not knows_ticks:
        times = [time_ns for _, time_ns, body in read_messages(path, ["gateway.state"]) if body.tick == end.tick]
        end = Moment(tick=-1, time_ns=times[0])
    ticks = {topic: frame.body.tick for topic, frame in last_frames(path, end).items()}
    assert ticks["gateway.state"] == pytest.approx(FIRST_TICK + 200, abs=1)
    assert ticks["physics.state"] == pytest.approx(FIRST_TICK + 200, abs=2)


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(str(tmp_path / "a.sqlite"))


@pytest.fixture
def client(bench: Bench) -> Iterator[httpx.Client]:
    with (
        served(build_app(bench)) as [address],
        httpx.Client(base_url=address, timeout=PATIENCE_S, headers={ROLE: "trainee"}) as client,
    ):
        yield client


def keep(bench: Bench, recording: Path, scenario: str) -> int:
    with bench.store() as store:
        return store.add(attempt(recording, scenario), "heron-17", recording)


def test_a_report_has_it_where_the_scenario_asks_for_it(
    client: httpx.Client, bench: Bench, recordings: dict[str, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    number = keep(bench, recordings["in it"], "cholangiography")
    assert client.get(f"/attempts/{number}").json()["has_cholangiogram"] is True
    told = client.get(f"/attempts/{number}/cholangiogram")
    assert told.status_code == 200, told.text
    still = still_of(recordings["in it"], end_of(recordings["in it"]))
    assert told.json() == json.loads(msgspec.json.encode(still))
    monkeypatch.setattr("subprocess.run", None)
    assert client.get(f"/attempts/{number}/cholangiogram").content == told.content, "it is made once"
    bench.erase("heron-17", "instructor", recordings=False)
    assert not list(bench.replays.cholangiogram("a").parent.iterdir())


def test_a_request_does_not_wait_longer_than_the_page_does(
    client: httpx.Client, bench: Bench, recordings: dict[str, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    number = keep(bench, recordings["in it"], "cholangiography")
    monkeypatch.setattr(stills, "_ANSWER_S", 1e-3)
    assert client.get(f"/attempts/{number}/cholangiogram").status_code == 202
    monkeypatch.setattr(stills, "_ANSWER_S", PATIENCE_S)
    assert client.get(f"/attempts/{number}/cholangiogram").json()["words"], "the same process goes on"


def test_the_file_of_a_report_has_it_too(bench: Bench, recordings: dict[str, Path], tmp_path: Path) -> None:
    out = tmp_path / "report.html"
    for scenario, recording, has in (
        ("cholangiography", recordings["in it"], "Agent reaches the common duct."),
        ("cholangiography", tmp_path / "none.mcap", "It cannot be drawn: "),
        ("basic", recordings["in it"], ""),
    ):
        with bench.store() as store:
            number = store.add(attempt(recordings["in it"], scenario), "heron-17", recording)
            url = str(tmp_path / "a.sqlite")
        run_report(ReportRequest(str(number), out, 0, None, "mistels", None, url, DEFAULT_PAGE))
        html = out.read_text()
        assert ("Cholangiogram at the end" in html) == bool(has)
        assert has in html
        assert ("data:image/png;base64," in html) == has.startswith("Agent")


def test_other_scenarios_have_none_and_what_is_missing_is_said(
    client: httpx.Client, bench: Bench, recordings: dict[str, Path], tmp_path: Path
) -> None:
    number = keep(bench, recordings["in it"], "basic")
    assert client.get(f"/attempts/{number}").json()["has_cholangiogram"] is False
    refused = client.get(f"/attempts/{number}/cholangiogram")
    assert (refused.status_code, refused.json()) == (409, {"error": "the scenario basic asks for no cholangiogram"})
    gone = tmp_path / "gone.mcap"
    gone.write_bytes(recordings["in it"].read_bytes())
    number = keep(bench, gone, "cholangiography")
    gone.write_bytes(b"no recording")
    refused = client.get(f"/attempts/{number}/cholangiogram")
    assert refused.status_code == 409
    assert "gone.mcap" in refused.json()["error"]
    gone.unlink()
    assert client.get(f"/attempts/{number}").json()["has_cholangiogram"] is False
    assert "not there any more" in client.get(f"/attempts/{number}/cholangiogram").json()["error"]


def test_the_shipped_scenario_of_a_cholangiography_asks_for_it() -> None:
    assert load_scenario("cholangiography").cholangiogram
    assert not load_scenario("basic").cholangiogram
