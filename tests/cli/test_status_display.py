"""What `trocar up` shows while a rig starts, on a terminal of 80 columns."""

from __future__ import annotations

import io
from dataclasses import dataclass, field

import pytest
from rich.console import Console

import trocar.protocol.bodies as bodies
from trocar.services.cli import status_display
from trocar.services.cli.status_display import StatusDisplay
from trocar.services.runtime import log
from trocar.services.start import first_start
from trocar.services.supervisor.crew.member import MemberState
from trocar.services.supervisor.crew.processes import TABLE
from trocar.services.supervisor.judge.state_machine import RigState


@dataclass
class _Member:
    progress: tuple[str, float] | None
    state: MemberState = MemberState.STARTING
    up: bool = False


@dataclass
class _Rig:
    name: str = "stub"


@dataclass
class _Supervisor:
    """As much of a supervisor as the display looks at."""

    members: dict[str, _Member]
    state: RigState = RigState.STARTING
    page_address: str = "http://127.0.0.1:8080/#token=x"
    start_notice: str = first_start.NOTICE
    rig: _Rig = field(default_factory=_Rig)

    @property
    def crew(self) -> _Supervisor:
        return self


def _display(monkeypatch: pytest.MonkeyPatch, terminal: bool) -> tuple[StatusDisplay, io.StringIO]:
    written = io.StringIO()

    def console(**options: object) -> Console:
        del options["stderr"]
        return Console(file=written, width=80, force_terminal=terminal, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(status_display, "Console", console)
    monkeypatch.delenv(log.LEVEL_VARIABLE, raising=False)
    return StatusDisplay(), written


def _starting(stage: str, fraction: float) -> _Supervisor:
    return _Supervisor({spec.name: _Member((stage, fraction)) for spec in TABLE})


@pytest.mark.parametrize("stage", ["contact: 37 kernels compiled", "residual compliance", 9 * "a long stage "])
def test_lines_fit_80_columns_whatever_a_process_does(monkeypatch: pytest.MonkeyPatch, stage: str) -> None:
    display, _ = _display(monkeypatch, terminal=True)
    display._show_progress(_starting(stage, 0.437))  # type: ignore[arg-type]
    plain = Console(width=80, file=io.StringIO(), record=True)
    plain.print(display._bars.get_renderable())
    lines = plain.export_text().splitlines()
    assert len(lines) == len(TABLE)
    for line, spec in zip(lines, TABLE, strict=True):
        assert len(line) <= 80
        assert spec.name in line
        assert " 43% " in line, "rounded down: 100 is the end"


def test_a_bar_ends_at_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    display, _ = _display(monkeypatch, terminal=True)
    rig = _starting("step: 40 kernels compiled", 0.9996)
    display._show_progress(rig)  # type: ignore[arg-type]
    assert {task.fields["percent"] for task in display._bars.tasks} == {99}
    for member in rig.members.values():
        member.up = True
    display._show_progress(rig)  # type: ignore[arg-type]
    assert [(task.percentage, task.fields["percent"]) for task in display._bars.tasks] == len(TABLE) * [(100.0, 100)]


def test_a_first_start_is_told_at_once_where_nobody_has_a_terminal(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    display, _ = _display(monkeypatch, terminal=False)
    display.show_state(_starting("loading", 0.0))  # type: ignore[arg-type]
    out = capfd.readouterr().out.splitlines()
    assert out == ["the rig 'stub' is starting: open http://127.0.0.1:8080/#token=x", first_start.NOTICE]


@pytest.mark.parametrize(
    ("level", "shown"),
    [(None, ["warning", "error"]), ("debug", ["debug", "info", "warning", "error"]), ("error", ["error"])],
)
def test_events_are_shown_from_the_level_that_was_asked_for(
    monkeypatch: pytest.MonkeyPatch, level: str | None, shown: list[str]
) -> None:
    display, written = _display(monkeypatch, terminal=False)
    if level is not None:
        monkeypatch.setenv(log.LEVEL_VARIABLE, level)
        display = StatusDisplay()
    for name in log.LEVELS:
        display.event(bodies.Event(1.0, name, f"an event of {name}"))
    assert [name for name in log.LEVELS if f"an event of {name}" in written.getvalue()] == shown
