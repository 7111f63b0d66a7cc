"""`trocar up` begins anew where its page asks for that: with what the files say by then, at the same address."""

from __future__ import annotations

from typing import Any
from unittest.mock import Mock

import pytest

from trocar.services.cli import up
from trocar.services.runtime.errors import ConfigError
from trocar.services.runtime.process.process import Options

PORT = 8123


def run(begins_again: bool, scenario: str = "") -> Mock:
    return Mock(begins_again=begins_again, next_scenario=scenario, port=PORT)


@pytest.fixture
def sessions(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, Options, tuple[str, ...]]]:
    """Return what each session was begun with; the first asks for a new start, the second for a scenario."""
    begun: list[tuple[Any, Options, tuple[str, ...]]] = []
    runs = [run(True), run(True, "narrow"), run(False)]

    def session(request: Any, options: Options, _token: str, remarks: tuple[str, ...], _server: Any) -> Mock:
        begun.append((request, options, remarks))
        return runs[len(begun) - 1]

    monkeypatch.setattr(up, "_run_session", session)
    monkeypatch.setattr(up.build, "build_fault", lambda: "")
    return begun


def test_a_new_start_reads_the_files_again_and_keeps_scene_and_address(
    sessions: list[tuple[Any, Options, tuple[str, ...]]], monkeypatch: pytest.MonkeyPatch
) -> None:
    read: list[tuple[str | None, str | None]] = []

    def options(request: up.UpRequest) -> Options:
        read.append((request.scene, request.scenario))
        return Options(request.rig, request.scene, request.overrides)

    monkeypatch.setattr(up.UpRequest, "options", options)
    up.run_up(up.UpRequest("mouse", "insertion", None, None, None, ("a=1",)), Mock())
    assert read == [("insertion", None), ("insertion", None), (None, "narrow")]
    assert [each.overrides for _, each, _ in sessions] == [("a=1",), *[("a=1", f"supervisor.web.port={PORT}")] * 2]


def test_what_cannot_be_begun_anew_is_told_and_what_ran_begins_again(
    sessions: list[tuple[Any, Options, tuple[str, ...]]], monkeypatch: pytest.MonkeyPatch
) -> None:
    answers = iter([None, "mouse.yaml: gateway: is no mapping", None])

    def options(request: up.UpRequest) -> Options:
        if why := next(answers):
            raise ConfigError(why)
        return Options(request.rig, request.scene, request.overrides)

    monkeypatch.setattr(up.UpRequest, "options", options)
    up.run_up(up.UpRequest("mouse", None, None, None, None, ()), Mock())
    assert sessions[1][2] == ("the rig cannot be run: mouse.yaml: gateway: is no mapping",)
    assert sessions[1][1].rig == "mouse"
