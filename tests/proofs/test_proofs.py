"""The proofs themselves: what was tried is kept and gone on with, and each can fail."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.proofs import flat, frames, hands, recordings
from tests.proofs.page import code_of, page
from tests.proofs.recordings import FRAMES, Original, judge_cut, judge_flip, original
from tests.proofs.trials import Found, Ledger, Proof, Try, counted, go_on, tried
from tests.rig.conftest import Sample
from tests.rig.faults import force_rates_n_s, rate_limit_n_s


class Tried:
    """A proof whose trials of three cases fail when they are told to, and how often it was begun."""

    def __init__(self, *, at_once: bool = False) -> None:
        self.begun, self.fails, self.made = 0, False, 0
        self.proof = Proof("made-up", "made-up cases", 30, "Nothing.", self._begin, at_once=at_once)

    @contextmanager
    def _begin(self) -> Iterator[Try]:
        self.begun += 1
        yield self._try

    def _try(self, _chance: np.random.Generator) -> Found:
        self.made += 1
        return Found("odd", tried=3, failed=int(self.fails), why=("it broke",) * self.fails)


def _silent(_text: str) -> None:
    return


def _until(count: int, some: Tried, ledger: Ledger, monkeypatch: pytest.MonkeyPatch) -> None:
    """Go on until so many trials were made, by a clock of their number."""
    with monkeypatch.context() as patch:
        patch.setattr(time, "monotonic", lambda: float(some.made))
        go_on(some.proof, ledger, float(count), _silent)


def test_a_run_goes_on_where_the_last_one_was_killed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    some, ledger = Tried(), Ledger(tmp_path, "abc")
    _until(4, some, ledger, monkeypatch)
    assert "|made-up cases|12 of 30|0|0 to 26.5 %|" in page({some.proof: ledger.lines(some.proof)}, "")
    with (tmp_path / "made-up.jsonl").open("a") as file:
        file.write('{"commit": "ab')
    _until(100, some, ledger, monkeypatch)
    lines = ledger.lines(some.proof)
    assert [each.beginning for each in lines] == [1] * 4 + [2] * 6
    assert len({each.seed for each in lines}) == 10
    assert "|made-up cases|30|0|" in page({some.proof: lines}, "")


def test_what_failed_is_begun_anew_and_stays_on_the_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    some, ledger = Tried(), Ledger(tmp_path, "abc")
    some.fails = True
    _until(2, some, ledger, monkeypatch)
    some.fails = False
    _until(100, some, ledger, monkeypatch)
    assert some.begun == 3
    text = page({some.proof: ledger.lines(some.proof)}, "")
    assert "|made-up cases|30|2|0.818 to 22.1 %|" in text
    assert text.count("it broke") == 2


def test_what_is_to_run_on_counts_from_one_beginning(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    some, ledger = Tried(at_once=True), Ledger(tmp_path, "abc")
    _until(4, some, ledger, monkeypatch)
    _until(6, some, ledger, monkeypatch)
    assert len(counted(some.proof, ledger.lines(some.proof))) == 4
    _until(100, some, ledger, monkeypatch)
    _until(200, some, ledger, monkeypatch)
    assert len(counted(some.proof, ledger.lines(some.proof))) == 10
    assert some.begun == 3


def test_old_code_says_how_old_it_is_and_lost_code_that_it_is_lost() -> None:
    short, day = subprocess.run(
        ["git", "log", "-1", "--format=%h %cs"], cwd=flat.ROOT, capture_output=True, text=True, check=True
    ).stdout.split()  # fmt: skip
    assert code_of([short, short]) == f"{short} ({day}, 0 commits ago)"
    lost = "1 of 2 trials by code that cannot be named: its commit is not in the history"
    assert code_of([short, "0" * 12]) == f"{short} ({day}, 0 commits ago); {lost}"


def test_cases_that_a_search_made_are_one_chance_of_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    some, ledger = Tried(), Ledger(tmp_path, "abc")
    some.fails, some.proof = True, replace(some.proof, chance_of="searches")
    _until(1, some, ledger, monkeypatch)
    some.fails = False
    _until(100, some, ledger, monkeypatch)
    text = page({some.proof: ledger.lines(some.proof)}, "")
    assert "|made-up cases|30, by 10 searches|1|0.253 to 44.5 % of searches|" in text


def test_an_unexpected_end_is_a_failure_and_not_the_end() -> None:
    def breaks(_chance: np.random.Generator) -> Found:
        raise MemoryError("much")

    found = tried(breaks, 1)
    assert found.failed == 1
    assert "MemoryError: much" in found.why[0]


def test_growth_is_the_slope_of_what_is_held() -> None:
    noise = np.random.default_rng(3).standard_normal(60)
    low, high = flat.growth((100.0 + 0.1 * np.arange(60) + noise).tolist())
    assert low < 6.0 < high < low + 4.0


def test_a_leak_is_told_when_it_is_sure_and_more_misses_after_an_hour() -> None:
    """What is allowed is the month that a container's memory leaves: some 5 MB in an hour."""
    chance = np.random.default_rng(3)

    def judged(minutes: int, leak_mb: float = 0.0, late: float = 0.0) -> list[str]:
        held = 100.0 + leak_mb * np.arange(minutes) / 60.0 + 0.1 * chance.standard_normal(minutes)
        misses = chance.exponential(1.0, minutes) + late * (np.arange(minutes) >= minutes // 2)
        return flat.judge([{"training MB": a, "physics misses": b} for a, b in zip(held, misses, strict=True)])

    assert judged(60) == judged(59, late=3.0) == judged(9, leak_mb=600.0) == judged(20, leak_mb=4.5) == []
    assert "training grows by" in judged(10, leak_mb=600.0)[0]
    assert "training grows by" in judged(60, leak_mb=7.0)[0]
    assert judged(60, late=3.0) == ["physics misses more deadlines in the second half than in the first"]


def test_frames_that_break_the_decoder_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    assert frames.try_frames(np.random.default_rng(5), 200).failed == 0
    monkeypatch.setattr(frames, "outcome", lambda _topic, data: 1 // (len(data) % 2))
    found = frames.try_frames(np.random.default_rng(5), 200)
    assert 0 < found.failed < 200
    assert len(found.why) == 10


def test_hands_that_gain_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    """A Premium whose force may give what nobody put in, and the same searches with the bound."""
    monkeypatch.setattr(hands, "KINDS", ("phantom_premium_1_5",))
    free, bounded = (
        [hands.try_hands(np.random.default_rng(seed), bounded=each, generations=20) for seed in range(4)]
        for each in (False, True)
    )
    gaining = [each for each in free if each.failed]
    assert gaining
    assert "phantom_premium_1_5 | no" in gaining[0].why[0]
    assert all(each.tried > 200 and (each.failed, each.why) == (0, ()) for each in bounded)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Original:
    return original(tmp_path_factory.mktemp("whole"))


def test_a_recording_that_is_read_otherwise_than_it_was_written_is_told(whole: Original, tmp_path: Path) -> None:
    path, size = tmp_path / "a.mcap", whole.until[2][0] + 10
    assert judge_cut(whole, size, path) == ""
    assert judge_cut(replace(whole, frames=whole.frames[1:]), size, path).startswith("other frames")
    assert (
        judge_cut(replace(whole, until=[(end // 3, count) for end, count in whole.until]), size, path)
        == "whole chunks were lost"
    )
    bit = 8 * (len(whole.data) - 4)  # of the last word, which is written anew
    assert judge_flip(whole, bit, path) == ""
    assert judge_flip(replace(whole, frames=whole.frames[1:]), bit, path) == "a frame was read that was never written"
    assert "lost in silence" in judge_flip(replace(whole, frames=[*whole.frames, (0, None)]), bit, path)


def test_a_flip_within_a_chunk_is_told(whole: Original, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, bit = tmp_path / "a.mcap", 8 * (whole.until[1][0] - 50)
    assert len(whole.frames) == FRAMES
    assert judge_flip(whole, bit, path) == ""
    monkeypatch.setattr(recordings, "_read", lambda _path: whole.frames[:-1])
    monkeypatch.setattr(recordings, "repair", lambda _path: None)
    assert judge_flip(whole, bit, path) == "1 frames were lost in silence"


def test_a_flip_in_what_describes_a_recording_is_told(
    whole: Original, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, (metadata, attachments) = tmp_path / "a.mcap", whole.extras
    at = whole.data.index(attachments["scene.npz"])
    for bit in (8 * (at + 5), 8 * whole.data.index(b"wall_minus_monotonic_ns")):
        assert judge_flip(whole, bit, path) == ""
    monkeypatch.setattr(recordings, "repair", lambda _path: None)
    monkeypatch.setattr(recordings, "read_extras", lambda _path: ({}, attachments))
    assert judge_flip(whole, bit, path) == "what describes the recording changed in silence"
    monkeypatch.setattr(recordings, "read_extras", lambda _path: (metadata, {"scene.npz": b""}))
    assert judge_flip(whole, bit, path) == "an attachment was read that was never written"


def test_what_cannot_be_begun_is_a_failure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    some, ledger = Tried(), Ledger(tmp_path, "abc")

    @contextmanager
    def begin() -> Iterator[Try]:
        if ledger.lines(some.proof):
            yield some._try
        raise OSError("no rig")

    some.proof = replace(some.proof, begin=begin)
    with pytest.raises(OSError, match="no rig"):  # when it is ended: that is the tests' own
        _until(100, some, ledger, monkeypatch)
    lines = ledger.lines(some.proof)
    assert "no rig" in lines[0].found.why[0]
    assert [each.found.failed for each in lines] == [1] + [0] * 10


@pytest.mark.parametrize(
    ("force_n", "way_m", "is_step"),
    [
        ((0.0, 0.0, 1.15), 0.0, False),
        ((0.0, 0.0, 1.3), 0.0, True),
        ((0.3, 0.0, 1.0), 0.0, True),
        ((0.0, 0.0, 0.7), 0.0, True),
        ((0.0, 0.0, 0.7), 0.25e-3, False),
        ((0.0, 0.0, 0.3), 0.25e-3, True),
        ((0.0, 0.0, 1.3), 0.25e-3, True),
        ((0.0, 0.0, 0.7), -0.25e-3, True),
    ],
)
def test_a_force_step_is_what_neither_the_limit_nor_a_hand_that_draws_back_accounts_for(
    force_n: tuple[float, float, float], way_m: float, is_step: bool
) -> None:
    before = Sample(0, 0, 1, 1, (0.0, 0.0, 1.0), "active", 1e-3)
    after = Sample(0, 1_000_000, 1, 2, force_n, "active", 1e-3, hip_m=(0.0, 0.0, way_m))
    assert (force_rates_n_s([before, after])[0] > rate_limit_n_s()) == is_step
