"""The whole supervisor over simulated time: processes on the memory bus, a clock that the test holds."""

from __future__ import annotations

import math
import random
import re
from pathlib import Path

import msgspec
import pytest
from prometheus_client import generate_latest

import trocar.protocol.bodies as bodies
from tests.supervisor.made_up import MS, Bench, rig, shown
from trocar.protocol.arrays import pack
from trocar.services.runtime.measures.histogram import BUCKETS
from trocar.services.supervisor.crew.member import MemberState
from trocar.services.supervisor.judge.governor import Level
from trocar.services.supervisor.judge.state_machine import RigState
from trocar.services.supervisor.page.metrics import RigSource, registry

STRICT = {"contracts": {"loops": {"physics": {"rate_hz": 1000, "miss_ratio": 0.01}}}}


def running(bench: Bench) -> Bench:
    bench.run(5.0, lambda: bench.supervisor.state is RigState.RUNNING)
    assert bench.supervisor.state is RigState.RUNNING
    return bench


def test_from_off_to_running() -> None:
    bench = Bench(rig())
    bench.run(3.0)
    states = list(dict.fromkeys(body.state for body in bench.told()))
    assert states == ["starting", "ready", "running"]


def test_it_speaks_ten_times_a_second_and_at_once_on_change() -> None:
    bench = running(Bench(rig()))
    bench.told()
    bench.run(1.0, turn_s=0.01)  # five turns of just 20 ms may be a hair less than a tenth of a second
    assert 9 <= len(bench.told()) <= 11
    bench.supervisor.safe_stop("a test")
    bench.run(0.01)
    (body,) = bench.told()
    assert body.safe_stop
    assert body.state == "safe_stop"


def test_a_process_that_builds_for_long_is_waited_for() -> None:
    bench = Bench(rig())
    bench.peers["physics"].state = "starting"
    bench.run(30.0)
    assert bench.supervisor.state is RigState.STARTING
    bench.peers["physics"].state = "ready"
    running(bench)


@pytest.mark.parametrize("name", ["gateway", "haptics", "physics"])
def test_silence_of_a_fast_stream_is_noticed_within_100_ms(name: str) -> None:
    bench = running(Bench(rig()))
    bench.peers[name].alive = False
    passed = bench.run(1.0, lambda: bench.supervisor.state is RigState.DEGRADED)
    assert passed <= 0.1
    assert f"{bench.peers[name].spec.stream}: silent for" in bench.supervisor.reason
    assert "limit 60 ms" in bench.supervisor.reason


@pytest.mark.parametrize("name", ["visualization", "recorder"])
def test_silence_of_a_slow_process_is_noticed_by_its_heartbeat(name: str) -> None:
    bench = running(Bench(rig()))
    bench.peers[name].alive = False
    assert bench.run(2.0, lambda: bench.supervisor.state is RigState.DEGRADED) <= 0.7
    assert f"{name}.health: silent for" in bench.supervisor.reason


def test_running_again_soon_after_the_process_is_back() -> None:
    bench = running(Bench(rig()))
    bench.peers["physics"].alive = False
    bench.run(5.0)
    assert bench.supervisor.crew.members["physics"].state is MemberState.LOST
    bench.peers["physics"].reborn(bench.now_s)
    assert bench.run(5.0, lambda: bench.supervisor.state is RigState.RUNNING) <= 3.0
    assert bench.supervisor.crew.members["physics"].restarts.count == 1
    assert not bench.supervisor.body().safe_stop


def test_what_a_loop_lost_while_another_was_away_is_not_held_against_it() -> None:
    """It counts the ticks that it could not have had when the first one comes: after the other is back."""
    bench = running(Bench(rig(**STRICT)))
    bench.peers["haptics"].alive = False
    bench.run(5.0)
    bench.peers["haptics"].reborn(bench.now_s)
    bench.run(5.0, lambda: bench.supervisor.crew.all_ready)
    bench.told()
    bench.run(0.05)
    bench.peers["physics"].misses += 5000
    assert bench.run(5.0, lambda: bench.supervisor.state is RigState.RUNNING) <= 3.0
    bench.run(10.0)
    assert not [body.reason for body in bench.told() if "lost" in body.reason]


def lose(bench: Bench, ticks: int) -> None:
    """Let physics lose `ticks`, a few in each report, over three seconds."""
    for _ in range(30):
        bench.peers["physics"].misses += ticks // 30
        bench.run(0.1)


@pytest.mark.parametrize("when", ["start", "restart"])
def test_the_budget_of_a_minute_begins_when_the_rig_runs(when: str) -> None:
    """What is lost while processes start, or start anew, is no alarm a minute long."""
    contracts = {"loops": {"physics": {"rate_hz": 1000, "miss_ratio": 0.001}}}
    bench = Bench(rig(contracts=contracts))
    if when == "restart":
        running(bench)
        bench.run(10.0)
    bench.peers["haptics"].alive = False
    bench.run(1.0)
    lose(bench, 3000)
    bench.peers["haptics"].alive = True
    running(bench)
    bench.told()
    lose(bench, 30)  # with one of those before, more than 60
    bench.run(5.0)
    assert {body.state for body in bench.told()} == {"running"}
    lose(bench, 60)
    assert any("ticks lost in the last minute, budget 60" in body.reason for body in bench.told())


def test_a_brief_silence_costs_nothing_but_the_state() -> None:
    bench = running(Bench(rig()))
    bench.peers["haptics"].alive = False
    bench.run(0.2)
    bench.peers["haptics"].alive = True
    assert bench.run(3.0, lambda: bench.supervisor.state is RigState.RUNNING) <= 1.2
    assert bench.supervisor.crew.members["haptics"].restarts.count == 0


def stall(bench: Bench, seconds: float, every_s: float = 0.5) -> None:
    """Let physics fall silent for 0.1 s, again and again."""
    for _ in range(round(seconds / every_s)):
        bench.peers["physics"].alive = False
        bench.run(0.1)
        bench.peers["physics"].alive = True
        bench.run(every_s - 0.1)


def test_a_rig_that_cannot_settle_runs_degraded_on_a_lower_quality() -> None:
    """A machine too slow for the scene: each stall alone is forgiven, and without this the rig would start for ever."""
    bench = Bench(rig(), levels=2)
    bench.run(0.5)
    stall(bench, 3.0)
    states = list(dict.fromkeys(body.state for body in bench.told()))
    assert states[-1] == "degraded"
    assert "running" not in states
    assert bench.supervisor.reason.startswith("physics")
    assert any(breach.text.startswith("physics: fell silent") for breach in bench.supervisor.breaches)
    stall(bench, 6.0)
    assert bench.supervisor.enforcement.level == 1
    stall(bench, 30.0)
    assert not bench.supervisor.body().safe_stop, "a rig that limps is better than one that is stopped"
    bench.run(15.0)
    assert bench.supervisor.state is RigState.RUNNING


def test_a_rig_is_not_degraded_before_all_have_come_up() -> None:
    bench = Bench(rig())
    bench.peers["visualization"].state = "starting"
    stall(bench, 5.0)
    assert bench.supervisor.state is RigState.STARTING


def test_its_own_absence_counts_against_nobody() -> None:
    """The supervisor was stopped for ten seconds: on return it accuses no one."""
    bench = running(Bench(rig()))
    bench.now_s += 10.0
    bench.supervisor.step(bench.now_s)
    assert bench.supervisor.state is RigState.RUNNING
    assert any("supervisor: held up for 1" in event.text for event in bench.supervisor.events)


def test_what_was_not_heard_yet_is_not_silence() -> None:
    """The bus' own thread waits for a processor: nobody is called silent, but not for ever."""
    bench = running(Bench(rig()))
    bench.supervisor.crew.has_heard_all = lambda: False
    bench.peers["gateway"].alive = False
    bench.run(0.4)
    assert bench.supervisor.state is RigState.RUNNING
    bench.run(0.3)
    assert bench.supervisor.state is RigState.DEGRADED


def test_enforcement_in_order_and_only_arming_leads_back() -> None:
    bench = running(Bench(rig(**STRICT), levels=3))
    bench.peers["physics"].miss_ratio = 0.6
    seen = []
    for _ in range(300):
        bench.run(0.1)
        body = bench.supervisor.body()
        seen.append((body.state, body.quality_level))
        if body.safe_stop:
            break
    # Somebody else's processes: judged and commanded, not restarted.
    assert list(dict.fromkeys(seen)) == [
        ("running", 0), ("degraded", 0), ("degraded", 1), ("degraded", 2), ("safe_stop", 2),
    ]  # fmt: skip
    assert "physics: 60.0 % of the ticks lost" in bench.supervisor.reason
    assert "limit 50.0 %" in bench.supervisor.reason

    bench.peers["physics"].miss_ratio = 0.0
    bench.run(10.0)
    assert bench.supervisor.state is RigState.SAFE_STOP
    bench.supervisor.arm("a test")
    running(bench)
    assert not bench.supervisor.body().safe_stop


def test_a_stall_within_the_budget_is_a_mark_and_no_alarm() -> None:
    """The loop measured it: said once, with its length; the state stays."""
    bench = running(Bench(rig(**STRICT), levels=2))
    bench.run(2.0)
    bench.peers["physics"].misses += 40
    bench.peers["physics"].stalls = (bodies.Stall(index=1, ended_ns=5, length_ns=41_300_000),)
    bench.run(8.0)
    assert "degraded" not in {body.state for body in bench.told()}
    marks = [event.text for event in bench.supervisor.events if "stalled" in event.text]
    assert marks == ["physics: stalled for 41 ms, by its own measure"]


def test_a_rig_that_misses_within_its_budget_is_running_all_the_time() -> None:
    bench = running(Bench(rig(**STRICT)))
    bench.told()
    for _ in range(60):
        bench.peers["physics"].misses += 9
        bench.run(1.0)
    assert {body.state for body in bench.told()} == {"running"}


def test_an_overdrawn_budget_degrades_and_passes_seconds_after_it_ended() -> None:
    bench = running(Bench(rig(**STRICT), levels=1))
    for _ in range(70):
        bench.peers["physics"].misses += 10
        bench.run(0.1)
    assert bench.supervisor.state is RigState.DEGRADED
    assert "ticks lost in the last minute, budget 600" in bench.supervisor.reason
    assert bench.run(10.0, lambda: bench.supervisor.state is RigState.RUNNING) <= 8.0


def test_a_slight_breach_never_stops_the_rig() -> None:
    bench = running(Bench(rig(**STRICT), levels=2))
    bench.peers["physics"].miss_ratio = 0.1
    bench.run(60.0)
    assert bench.supervisor.state is RigState.DEGRADED
    assert bench.supervisor.enforcement.level == 1
    assert not bench.supervisor.body().safe_stop


def test_a_breach_of_what_is_not_critical_touches_no_quality() -> None:
    contracts = {"contracts": {"loops": {"visualization": {"rate_hz": 1000, "miss_ratio": 0.01}}}}
    bench = running(Bench(rig(**contracts), levels=2))
    bench.peers["visualization"].miss_ratio = 0.9
    bench.run(30.0)
    assert bench.supervisor.state is RigState.DEGRADED
    assert bench.supervisor.enforcement.level == 0
    assert not bench.supervisor.body().safe_stop


def test_commanded_safe_stop_stays_until_armed() -> None:
    bench = running(Bench(rig()))
    bench.supervisor.safe_stop("the web page")
    bench.run(20.0)
    assert bench.supervisor.state is RigState.SAFE_STOP
    assert bench.supervisor.reason == "commanded by the web page"
    bench.supervisor.arm("a person")
    assert bench.run(5.0, lambda: bench.supervisor.state is RigState.RUNNING) <= 2.0


def test_everybody_is_told_how_often_the_rig_was_armed_also_while_it_runs() -> None:
    bench = running(Bench(rig()))
    for times in (1, 2):
        bench.supervisor.arm("a person")
        bench.run(0.1)
        assert bench.supervisor.state is RigState.RUNNING
        assert bench.supervisor.body().armed == times


def test_a_safe_stop_survives_the_supervisor_that_made_it(tmp_path: Path) -> None:
    """Compose restarts a dead supervisor; that arms nobody."""
    memory = tmp_path / "safe_stop"
    bench = running(Bench(rig(), memory=memory))
    bench.supervisor.safe_stop("a test")
    bench.run(0.1)
    second = Bench(rig(), memory=memory)
    second.run(5.0)
    assert second.supervisor.state is RigState.SAFE_STOP
    second.supervisor.arm("a person")
    running(second)
    assert not memory.exists()


def test_nothing_a_process_says_of_itself_breaks_the_supervisor() -> None:
    """Well-formed health bodies with absurd figures, in any order: judged, shown and exported, never fatal."""
    generator = random.Random(7)
    bench = Bench(rig(**STRICT), levels=2)
    bench.run(1.5)
    numbers = [0.0, -1.0, 1e300, math.nan, math.inf, 3.0, 1e-300]
    counts = [0, 1, 1 << 40, (1 << 63) - 1]

    def wild() -> bodies.Histogram:
        values = [generator.choice([*counts, -(1 << 63)]) for _ in range(generator.choice([BUCKETS, BUCKETS, 3]))]
        deadline = generator.choice([1, MS, 1 << 62])
        size = generator.choice(counts)
        return bodies.Histogram(
            deadline_ns=deadline,
            counts=pack(values, "<i8"),
            total=size,
            sum_ns=-size,
            max_ns=generator.choice([-1, size]),
        )

    for turn in range(150):
        loop = bodies.LoopReport(
            rate_hz=1.0, ticks=generator.choice(counts), misses=generator.choice(counts),
            skipped=generator.choice(counts), lateness=wild(), work=wild(), period=wild(),
        )  # fmt: skip
        path = bodies.PathLatency(name="device_model", latency=wild(), answered=generator.choice(counts), asked=1)
        topic = bodies.TopicReport(topic="x", sent=generator.choice(counts), refused={"": 1 << 62}, age=wild())
        body = bodies.Health(
            process="physics", pid=generator.choice([1, 2]), state=generator.choice(["ready", "", "mad"]),
            uptime_s=generator.choice(numbers), loop=loop, paths=(path,), topics=(topic,),
            gauges={"": generator.choice(numbers)},
        )  # fmt: skip
        bench.peers["physics"].bus.publish("physics.health", body)
        bench.peers["physics"].next_health_s = math.inf
        bench.run(0.01)
        if turn % 10 == 0:
            assert b"NaN" not in msgspec.json.encode(shown(bench))
            source = RigSource(bench.supervisor.body(), {"physics": body})
            assert b"trocar_loop" in generate_latest(registry(lambda source=source: source))


def test_events_name_what_happened_in_order() -> None:
    bench = running(Bench(rig()))
    bench.peers["gateway"].alive = False
    bench.run(3.0)
    texts = [event.text for event in bench.supervisor.events]
    assert texts[0].startswith("supervisor: starting")
    assert any(text.startswith("gateway.state: silent") for text in texts)
    assert any(text.startswith("supervisor: degraded: gateway.state: silent") for text in texts)


def test_only_a_change_of_quality_for_the_worse_is_a_warning() -> None:
    bench = running(Bench(rig(**STRICT), levels=2))
    bench.peers["physics"].miss_ratio = 0.1
    bench.run(30.0, lambda: bench.supervisor.enforcement.level == 1)
    bench.peers["physics"].miss_ratio = 0.0
    bench.run(300.0, lambda: bench.supervisor.enforcement.level == 0)
    said = [(event.level, event.text) for event in bench.supervisor.events]
    assert [level for level, text in said if "lower the quality level" in text] == ["warning"]
    assert [level for level, text in said if "raise the quality level" in text] == ["info"]


def test_what_the_rung_in_force_costs_in_accuracy_is_told_to_all_and_exported() -> None:
    bench = running(Bench(rig(**STRICT), levels=(Level("full", 400.0, 0.5, 0.25), Level("dry", 250.0, 1.5, 2.0))))
    bench.peers["physics"].miss_ratio = 0.1
    bench.run(30.0, lambda: bench.supervisor.enforcement.level == 1)
    bench.run(0.2)
    told = bench.told()[-1]
    assert told.quality_level == 1
    dry = bodies.QualityReport(
        name="dry", rungs=2, cost_us=250.0, force_error_percent=1.5, motion_error_percent=2.0, lowered=1
    )
    assert told.quality == dry
    assert any("now 'dry', 150 us less a tick, force off by 1.5 %" in event.text for event in bench.supervisor.events)
    assert msgspec.to_builtins(shown(bench).quality)["force_error_percent"] == 1.5
    text = generate_latest(registry(lambda: RigSource(told))).decode()
    assert "trocar_quality_cost_seconds 0.00025" in text
    assert 'trocar_quality_error_ratio{of="motion"} 0.02' in text
    assert 'trocar_quality_switches_total{direction="down"} 1.0' in text


def test_a_flood_is_in_the_history_once_by_the_name_of_who_floods() -> None:
    bench = running(Bench(rig()))
    for seconds, expected in ((3.0, 1), (9.0, 2)):
        for _ in range(round(seconds / 0.1)):
            for name, reader in (("physics", "haptics"), ("visualization", "recorder")):
                bench.peers[name].gauges["flood.haptics.contacts"] = bench.now_s
                bench.peers[reader].gauges["flood.nothing.known"] = bench.now_s
            bench.run(0.1)
        texts = [event.text for event in bench.supervisor.events if "floods" in event.text]
        assert len(texts) == expected
    assert re.fullmatch(
        r"haptics: floods haptics.contacts: \d+ frames beyond three times 1000 Hz, as \w+ counts them", texts[0]
    )
    assert bench.supervisor.state is RigState.RUNNING, "the hand does not notice: a mark"


def test_what_a_process_of_another_container_says_is_wrong_with_it_is_in_the_history_once() -> None:
    bench = running(Bench(rig()))
    bench.peers["recorder"].state, bench.peers["recorder"].detail = "degraded", "the disk has held a write for 30 ms"
    assert bench.run(1.0, lambda: any("disk" in event.text for event in bench.supervisor.events)) <= 0.12
    bench.run(2.0)
    assert [e.text for e in bench.supervisor.events if "disk" in e.text] == [
        "recorder: the disk has held a write for 30 ms"
    ]


def test_a_count_of_another_container_that_goes_on_leaves_room_in_the_history() -> None:
    bench = running(Bench(rig()))
    recorder = bench.peers["recorder"]
    recorder.state = "degraded"
    for second in range(40):
        recorder.detail = f"lost {second + 1} frames: {second + 1} of physics.state (the disk is too slow)"
        bench.run(1.0)
    bench.run(11.0)
    told = [e.text for e in bench.supervisor.events if "lost" in e.text]
    assert told[0].startswith("recorder: lost 1 frames")
    assert told[-1].startswith("recorder: lost 40 frames"), "the last number is told though it changes no more"
    assert 4 <= len(told) <= 6
    recorder.detail = "lost 40 frames: 40 of gateway.state (the recorder was not run)"
    assert bench.run(1.0, lambda: "gateway.state" in bench.supervisor.events[-1].text) <= 0.12, "other words: at once"
