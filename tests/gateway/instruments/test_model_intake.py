from __future__ import annotations

from typing import Any

import pytest

from trocar.protocol import Frame
from trocar.protocol.bodies import ContactModel, LocalModel
from trocar.services.gateway.instruments.model_intake import ModelIntake
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.runtime.measures.histogram import LatencyHistogram
from trocar.services.runtime.process.health import LatencyPath

FREE = LocalModel()
PUSH = LocalModel(force_n=(0.1, 0.2, 0.3), reference_velocity_m_s=(4.0, 5.0, 6.0), in_contact=True)


class Stub:
    """What `ModelIntake` uses of an instrument."""

    def __init__(self) -> None:
        self.servo = self
        self.model_sequence = -1
        self.accepted: list[tuple[float, int, int]] = []

    def accept(self, model: FloatArray, ttl_s: float, answers_ns: int, incarnation: int) -> None:
        self.model = LocalModel.from_row(model)
        self.accepted.append((ttl_s, answers_ns, incarnation))


class Chain:
    """ModelIntake with two instruments, and frames that come in."""

    def __init__(self) -> None:
        self.arrival, self.force = LatencyPath(LatencyHistogram(800_000)), LatencyPath(LatencyHistogram(2_000_000))
        self.instruments = [Stub(), Stub()]
        self.answers = ModelIntake(self.instruments, self.arrival, self.force)  # type: ignore[arg-type]

    def come(
        self, tick: int, now_ns: int = 0, *, valid: bool = True, instruments: int = 2, model: LocalModel = FREE
    ) -> None:
        body = ContactModel.of(tick, 0.02, (model,) * instruments)
        self.answers.accept(Frame(1, "haptics.contact_model", 1, 7, tick, 0, 0, valid, body), now_ns)


def test_a_model_is_dated_by_the_sample_that_it_answers() -> None:
    chain = Chain()
    chain.answers.ask(4, 1_000, timed=True)
    chain.come(4, 301_000, model=PUSH)
    assert [stub.model for stub in chain.instruments] == [PUSH, PUSH]
    assert [stub.accepted for stub in chain.instruments] == [[(0.02, 1_000, 7)]] * 2
    assert [stub.model_sequence for stub in chain.instruments] == [4, 4]
    assert (chain.arrival.latency.total, chain.arrival.latency.max_ns) == (1, 300_000)
    chain.answers.applied(1_001_000)
    assert chain.force.latency.max_ns == 1_000_000


@pytest.mark.parametrize(
    ("frame", "reason"),
    [
        ({"tick": 9}, "not_asked"),
        ({"tick": 4, "valid": False}, "invalid"),
        ({"tick": 4, "instruments": 1}, "instruments"),
        ({"tick": 4 + 128}, "not_asked"),
        ({"tick": 4, "model": LocalModel(grasp_stiffness_nm_rad=-1.0)}, "numbers"),
        ({"tick": 4, "model": LocalModel(grasp_damping_nm_s_rad=-1e-9)}, "numbers"),
    ],
)
def test_what_answers_nothing_that_was_asked_is_not_used(frame: dict[str, Any], reason: str) -> None:
    chain = Chain()
    chain.answers.ask(4, 1_000, timed=True)
    chain.come(**frame)
    assert chain.answers.refused[reason] == 1
    assert chain.instruments[0].accepted == []
    assert chain.answers.outstanding


def test_only_the_first_answer_to_a_sample_counts() -> None:
    chain = Chain()
    chain.answers.ask(4, 1_000, timed=True)
    for _ in range(3):
        chain.come(4, 300_000)
    assert chain.arrival.latency.total == 1


def test_the_share_answered_in_the_next_tick() -> None:
    chain = Chain()
    chain.answers.applied(0)
    for tick in range(10):
        chain.answers.ask(tick, 1_000 + tick, timed=False)
        if tick % 5 != 4:
            chain.come(tick, 2_000 + tick)
        chain.answers.applied(3_000 + tick)
    assert (chain.arrival.asked, chain.arrival.answered) == (10, 8)


def test_the_way_of_a_model_is_measured_where_it_was_waited_for_and_nowhere_else() -> None:
    chain = Chain()
    for tick in range(8):
        chain.answers.ask(tick, 1_000 * tick, timed=tick % 4 == 0)
        assert chain.answers.timed == (tick % 4 == 0)
        chain.come(tick, 1_000 * tick + 300)
        assert not chain.answers.timed
    assert (chain.arrival.latency.total, chain.arrival.latency.sum_ns) == (2, 600)


def test_a_model_that_comes_ticks_after_it_was_waited_for_still_counts() -> None:
    chain = Chain()
    chain.answers.ask(0, 1_000, timed=True)
    chain.answers.ask(1, 2_000, timed=False)
    chain.come(0, 5_000)
    assert (chain.arrival.latency.total, chain.arrival.latency.max_ns) == (1, 4_000)


def test_looks_that_find_most_models_invalid_are_counted_until_most_are_not() -> None:
    """Physics on a host that is too far away: nothing dies, and the arm is limp."""
    chain = Chain()

    def look(valid: str) -> int:
        for tick, good in enumerate(valid):
            chain.answers.ask(tick, 1_000, timed=False)
            chain.come(tick, valid=good == "v")
        return chain.answers.invalid_looks()

    assert [look(came) for came in ("", "vvx", "xxv", "xxx", "", "xx", "vv")] == [0, 0, 1, 2, 0, 1, 0]
