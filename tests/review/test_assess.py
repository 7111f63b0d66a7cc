"""Streams and recordings to assessments: attempts told apart, the same bytes again, cut files, rigs that were late."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.training.simulated import SimulatedRig, attempt, patient
from tests.training.streams import GOOD, SCENARIO, SITE, changed, messages
from trocar.protocol import TOPICS, Frame
from trocar.protocol.bodies import SupervisorState
from trocar.review.attempts.assess import Terms, assess
from trocar.review.attempts.assessment import Assessment
from trocar.review.attempts.faults import FaultLog
from trocar.review.attempts.recorded import assess_file
from trocar.services.mechanics.scenarios import insertion, miss
from trocar.services.recorder.recording import RecordingWriter
from trocar.services.runtime.errors import UserError
from trocar.services.training.score import load_rules
from trocar.services.training.site import Site

__all__ = ["patient"]
RULES = load_rules()
Stream = Iterator[tuple[str, int, msgspec.Struct]]


def terms(site: Site | None = SITE) -> Terms:
    return Terms(scenario_of=lambda _: SCENARIO, rules=RULES, site=site)


def word(state: str, tick: int, **said: object) -> Stream:
    yield "training.attempt", tick * 1_000_000, attempt(state, **said)


def told(stream: Stream, ends_s: float, **said: object) -> Stream:
    """An attempt that begins with the stream and is done with it."""
    end = {"outcome": "success", "time_s": ends_s} | said
    return chain(word("armed", 999), word("running", 1000), stream, word("done", 1000 + round(1000 * ends_s), **end))


def assessed(stream: Stream) -> Assessment:
    (found,) = assess(stream, terms(), "a.mcap")
    return found


def test_a_good_attempt_scores_what_it_saved() -> None:
    found = assessed(told(messages(GOOD), 16.0))
    assert (found.outcome, found.counts, found.errors) == ("success", True, [])
    assert found.score is not None
    assert found.score.total == pytest.approx(300.0 - 16.0)
    assert found.metrics["deepest_m"] == pytest.approx(15e-3)
    assert found.metrics["grasps"] == 1.0
    assert found.metrics["tool_duct.peak_n"] == pytest.approx(0.5 + 0.8)
    assert 0.0 < found.metrics["right.economy"] <= 1.0
    assert found.rig.lost_ticks == pytest.approx(19 / 20)  # the stream has one tick of twenty
    assert len(found.series.time_s) == len(found.series.loads_n["left"]) == len(found.series.paths_mm["tip"])


def test_errors_cost_what_the_rules_say_and_a_failure_is_worth_nothing() -> None:
    stream = changed({"traction": [(4.0, 0.3), (4.1, 3.0), (5.0, 3.0), (5.1, 0.3)]})
    found = assessed(told(messages(stream), 16.0))
    assert [error.code for error in found.errors] == ["E1"]
    assert found.score is not None
    assert found.score.total == pytest.approx(300.0 - 16.0 - RULES.penalty_s["consequential"])
    failed = assessed(told(messages(GOOD, 4.0), 4.0, outcome="failure"))
    assert failed.score is not None
    assert failed.score.total == 0.0


def test_a_catheter_left_too_deep_is_judged_at_the_end_of_an_attempt_that_secures_nothing() -> None:
    deep = changed({"inserted": [(2.5, 0.0), (8.0, 21e-3)]})
    found = assessed(told(messages(deep, 8.5), 8.5))
    assert [error.evidence for error in found.errors] == ["secured too deep"]
    assert assessed(chain(word("running", 1000), messages(deep, 8.5))).errors == []


def test_every_attempt_of_a_recording_is_told_apart() -> None:
    first = chain(word("running", 1000, attempt_id="1"), messages(GOOD, 3.0), word("abandoned", 4000, attempt_id="1"))
    waiting = chain(word("armed", 4000, attempt_id="2"), messages(GOOD, 1.0, 4000))
    second = chain(word("running", 5000, attempt_id="2"), messages(GOOD, 5.0, 5000))
    found = list(assess(chain(first, waiting, second), terms(), ""))
    assert [(each.attempt_id, each.outcome) for each in found] == [("1", "abandoned"), ("2", "incomplete")]
    assert found[1].time_s == pytest.approx(5.0, abs=0.02)
    assert [each.score for each in found] == [None, None]


def test_without_the_attempt_that_follows_one_that_vanished_is_abandoned() -> None:
    first = chain(word("running", 1000, attempt_id="1"), messages(GOOD, 3.0))
    found = list(assess(chain(first, word("armed", 5000, attempt_id="2")), terms(), ""))
    assert [each.outcome for each in found] == ["abandoned"]


@pytest.mark.parametrize(
    ("state", "says"),
    [("degraded", "physics: 60 ticks lost"), ("safe_stop", "safe_stop"), ("running", ""), ("off", "")],
)
def test_an_attempt_in_which_the_rig_broke_its_contracts_does_not_count(state: str, says: str) -> None:
    reason = says if says != state else ""
    late = ("supervisor.state", 3_000_000_000, SupervisorState(state=state, reason=reason, safe_stop=state == "off"))
    found = assessed(told(chain(messages(GOOD, 8.0), [late], messages(GOOD, 1.0, 9000)), 9.0))
    assert found.counts == (not says)
    assert found.why_not == ((f"the rig broke its contracts: {says}",) if says else ())


def _late(reason: str) -> tuple[str, int, msgspec.Struct]:
    return "supervisor.state", 3_000_000_000, SupervisorState(state="degraded", reason=reason)


def test_what_a_late_rig_says_a_hundred_times_is_said_once() -> None:
    """92 sentences that differed in a number stood above advice and score."""
    said = [_late(f"physics: {count} ticks lost in the last minute, budget 60") for count in range(61, 153)]
    said += [_late("gateway: drive 1 does not answer"), _late("gateway: drive 3 does not answer")]
    said += [_late("path servo: p99 1200 us over 5 s, limit 900 us")] * 40
    found = assessed(told(chain(messages(GOOD, 8.0), said, messages(GOOD, 1.0, 9000)), 9.0))
    assert found.rig.faults == (
        "physics: 61 to 152 ticks lost in the last minute, budget 60 (said 92 times)",
        "gateway: drive 1, 3 does not answer (said 2 times)",
        "path servo: p99 1200 us over 5 s, limit 900 us",
    )
    assert found.why_not == (f"the rig broke its contracts: {'; '.join(found.rig.faults)}",)


@given(st.lists(st.tuples(st.sampled_from(["physics: {} ticks", "a: {} of {}", "x", "{}", "p99 {}.", ""]),
                          st.integers(0, 10**6), st.floats(0, 1e3)), max_size=60))  # fmt: skip
def test_whatever_is_said_each_form_is_there_once_with_its_values(said: list[tuple[str, int, float]]) -> None:
    log = FaultLog()
    for form, count, share in said:
        log.take_sentence(form.format(count, f"{share:.1f}"))
    sentences = log.sentences()
    forms = {form for form, *_ in said if form}
    assert len(sentences) == len(forms)
    for form in forms:
        counts = [count for each, count, _ in said if each == form and "{}" in form]
        assert any(all(str(end) in each for end in counts and (min(counts), max(counts))) for each in sentences)


def test_the_moments_before_the_first_word_are_no_attempt_and_minutes_are() -> None:
    """At the head of each recording stood a practice without a goal, abandoned after 0.0 s."""
    for head_s, outcomes in ((0.02, ["success"]), (2.0, ["success"]), (20.0, ["abandoned", "success"])):
        head = messages(GOOD, head_s, 1000)
        first = 1000 + round(1000 * head_s)
        done = word("done", first + 16_000, outcome="success", time_s=16.0)
        stream = chain(head, word("armed", first), word("running", first), messages(GOOD, 16.0, first), done)
        assert [each.outcome for each in assess(stream, terms(), "")] == outcomes


def test_what_the_rig_says_of_the_attempt_is_heard() -> None:
    found = assessed(told(messages(GOOD, 8.0), 8.0, counts=False, why_not="slow motion was used"))
    assert found.why_not == ("slow motion was used",)


def test_a_gap_in_the_recording_does_not_count() -> None:
    found = assessed(told(chain(messages(GOOD, 3.0), messages(GOOD, 3.0, 5000)), 7.0))
    assert found.rig.largest_gap_s == pytest.approx(1.0, abs=0.03)
    assert not found.counts


def test_ticks_that_jump_by_years_are_refused() -> None:
    with pytest.raises(UserError, match=r"a.mcap: an attempt of more than a day"):
        assessed(told(chain(messages(GOOD, 1.0), messages(GOOD, 1.0, 10**12)), 2.0))


def test_without_a_site_it_is_said_what_was_not_judged() -> None:
    (found,) = assess(told(messages(GOOD), 16.0), terms(None), "")
    assert found.not_judged == ("E2: area of the opening", "E11", "E12: view")
    assert found.errors == []


def recorded(path: Path, stream: Stream) -> Path:
    writer = RecordingWriter(path, {})
    for sequence, (topic, time_ns, body) in enumerate(stream):
        said = {"incarnation": 1, "sequence": sequence, "sent_ns": time_ns, "origin_ns": 0, "valid": True}
        writer.write(Frame(protocol=1, topic=topic, version=TOPICS[topic].version, body=body, **said))
        writer.end_old_chunk(time_ns)
    writer.close()
    return path


def test_scoring_a_file_again_gives_the_same_bytes_and_so_does_the_stream(tmp_path: Path) -> None:
    path = recorded(tmp_path / "a.mcap", messages(GOOD, 9.5))
    (once,), (again,) = (assess_file(path, RULES) for _ in range(2))
    assert msgspec.json.encode(once) == msgspec.json.encode(again)
    assert once.outcome == "incomplete"
    (live,) = assess(messages(GOOD, 9.5), terms(None), "a.mcap")
    assert live.metrics == once.metrics
    assert live.errors == once.errors
    assert live.phases == once.phases


def test_a_file_cut_anywhere_is_scored_as_incomplete(tmp_path: Path) -> None:
    whole = recorded(tmp_path / "a.mcap", messages(GOOD, 4.0)).read_bytes()
    chance = np.random.default_rng(11)
    cut = tmp_path / "cut.mcap"
    most = 0.0
    shortest = assess_file(recorded(tmp_path / "b.mcap", messages(GOOD, 4.0)), RULES)[0].time_s
    for size in sorted(chance.integers(8, len(whole), 30)):
        cut.write_bytes(whole[:size])
        times = []
        for found in assess_file(cut, RULES):
            assert found.outcome == "incomplete"
            assert found.score is None
            times.append(found.time_s)
        assert sum(times) >= most, "a longer file holds no less"
        most = max(most, sum(times))
    assert 1.0 < most <= shortest


@pytest.mark.usefixtures("patient")
def test_simulated_hands_that_insert_err_in_nothing_but_their_depth() -> None:
    """The scripted insertion pushes 1.7 mm beyond the second marker, and is otherwise as it should be."""
    rig = SimulatedRig(insertion())
    (found,) = assess(told(rig.messages(2.2), 2.2), terms(rig.site), "")
    assert [error.evidence for error in found.errors] == ["secured too deep"]
    assert [span.phase for span in found.phases] == ["P0", "P1", "P2", "P3", "P4"]
    assert found.metrics["deepest_m"] == pytest.approx(21.7e-3, abs=0.3e-3)
    assert found.metrics["grasps"] == 1.0
    assert found.metrics["right.path_m"] == pytest.approx(0.012 + 0.0043 + 0.002 + 0.0215, rel=0.1)


@pytest.mark.usefixtures("patient")
def test_simulated_hands_that_miss_are_caught() -> None:
    rig = SimulatedRig(miss())
    (found,) = assess(chain(word("running", 0), rig.messages(1.7)), terms(rig.site), "")
    assert {"E3", "E5"} <= {error.code for error in found.errors}
    assert found.metrics["deepest_m"] == 0.0
    assert [span.phase for span in found.phases] == ["P0", "P1", "P2", "P3"]
