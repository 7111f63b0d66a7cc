"""What `trocar up` says of a start where there is no terminal: a log, a service, a pipe."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import pytest

from services.cli import status_display
from services.cli.status_display import StatusDisplay
from services.supervisor.state_machine import RigState
from services.supervisor.supervisor import Supervisor


def member(name: str, *, up: bool = False, progress: tuple[str, float] | None = None) -> SimpleNamespace:
    return SimpleNamespace(name=name, up=up, progress=progress, state="starting")


def test_a_start_without_a_terminal_says_where_to_look_and_now_and_then_what_it_waits_for(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    now = SimpleNamespace(s=100.0)
    monkeypatch.setattr(status_display, "time", SimpleNamespace(monotonic=lambda: now.s))
    physics = member("physics", progress=("contact: 25 kernels compiled", 0.3))
    members = {"physics": physics, "haptics": member("haptics"), "recorder": member("recorder", up=True)}
    rig = SimpleNamespace(
        rig=SimpleNamespace(name="stub"), page_address="http://127.0.0.1:1/#token=x", state=RigState.STARTING,
        started_s=99.0, crew=SimpleNamespace(members=members),
    )  # fmt: skip
    with StatusDisplay() as display:
        for turn in range(1200):
            now.s = 100.0 + turn / 50
            if turn == 300:
                physics.progress = ("contact: 80 kernels compiled", 0.9)
            if turn == 700:
                rig.state = RigState.RUNNING
            display.turn(cast(Supervisor, rig))
    assert capsys.readouterr().err.splitlines() == [
        "the rig 'stub' is starting: open http://127.0.0.1:1/#token=x",
        "   1.00 s  physics: contact: 25 kernels compiled; haptics: starting",
        "  11.00 s  physics: contact: 80 kernels compiled; haptics: starting",
        "the rig 'stub' is running: open http://127.0.0.1:1/#token=x (Ctrl-C ends it)",
    ]
