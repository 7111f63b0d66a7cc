"""A store against a model of it: attempts are added, moved, erased and hindered, in any order."""

from __future__ import annotations

import json
import shutil
import tempfile
from pathlib import Path

import hypothesis.strategies as st
from hypothesis import settings
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from tests.by_day import examples
from tests.review.benches import made_up
from tests.review.test_erasing import RECORDING
from trocar.review.attempts.store.attempts import Store, StoreError

_TRAINEES = st.sampled_from(["heron", "wren", "magpie"])
_ATTEMPTS = st.integers(0, 5).map(str)
_FILES = st.sampled_from(["a.mcap", "b.mcap", "c.mcap"])


class Attempts(RuleBasedStateMachine):
    """`kept` is whose each attempt is and where its recording is; `stuck` are recordings that cannot be removed."""

    def __init__(self) -> None:
        super().__init__()
        self.folder = Path(tempfile.mkdtemp(prefix="trocar-model-")).resolve()
        self.store = Store(str(self.folder / "a.sqlite"))
        self.kept: dict[str, tuple[str, str]] = {}
        self.stuck: set[str] = set()

    def teardown(self) -> None:
        self.store.__exit__(None, None, None)
        shutil.rmtree(self.folder)

    @rule(name=_ATTEMPTS, trainee=_TRAINEES, file=_FILES)
    def add(self, name: str, trainee: str, file: str) -> None:
        if file not in self.stuck:
            (self.folder / file).write_bytes(RECORDING)
        self.store.add(made_up(name), trainee, self.folder / file)
        self.kept[name] = trainee, file

    @rule(file=_FILES)
    def hinder(self, file: str) -> None:
        if file not in self.stuck:
            (self.folder / file).unlink(missing_ok=True)
            (self.folder / file).mkdir()
            self.stuck.add(file)

    @rule()
    def let_go(self) -> None:
        for file in self.stuck:
            (self.folder / file).rmdir()
        self.stuck.clear()

    @rule(file=_FILES)
    def move_away(self, file: str) -> None:
        if file not in self.stuck:
            (self.folder / file).unlink(missing_ok=True)

    @rule()
    def open_anew(self) -> None:
        self.store.__exit__(None, None, None)
        self.store = Store(str(self.folder / "a.sqlite"), create=False)

    @rule(trainee=_TRAINEES)
    def erase(self, trainee: str) -> None:
        mine = {file for owner, file in self.kept.values() if owner == trainee}
        there = {file for file in mine if (self.folder / file).exists()}
        try:
            assert {path.name for path in self.store.erase(trainee)} == there
        except StoreError:
            assert not mine
        self.kept = {name: each for name, each in self.kept.items() if each[0] != trainee}

    @rule(trainee=_TRAINEES)
    def erase_with_recordings(self, trainee: str) -> None:
        mine = {file for owner, file in self.kept.values() if owner == trainee}
        others = {file for owner, file in self.kept.values() if owner != trainee}
        there = {file for file in mine if (self.folder / file).exists()}
        try:
            done = self.store.erase_with_recordings(trainee)
        except StoreError:
            assert not mine
            return
        failed = (mine & self.stuck) - others
        assert {path.name for path in done.removed} == there - others - failed
        assert {path.name for path in done.shared} == there & others
        assert {path.name for path in done.failed} == failed
        assert {path.name for path in done.missing} == mine - there
        assert not any((self.folder / file).exists() for file in there - others - failed)
        self.kept = {name: each for name, each in self.kept.items() if each[0] != trainee or each[1] in failed}

    @invariant()
    def what_is_kept_is_there_and_nothing_else(self) -> None:
        exported = json.loads(self.store.export())["attempts"]
        assert {each["attempt_id"]: (each["trainee"], Path(each["recording"]).name) for each in exported} == self.kept
        assert len(self.store.listed()) == len(self.kept)


TestAttempts = Attempts.TestCase
TestAttempts.settings = settings(max_examples=examples(12, 200), stateful_step_count=25, deadline=None)
