"""``trocar up``: the supervisor with its status on the terminal, and the report of a run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from services.cli import targets, validation
from services.cli.status_display import StatusDisplay
from services.runtime import config
from services.runtime.errors import DeviceError
from services.runtime.process import Options
from services.supervisor import run_report, session
from services.supervisor.nursery import Nursery
from services.supervisor.supervisor import Supervisor
from services.training.scenario import scenario_of
from services.visualization.web import build


@dataclass(frozen=True, slots=True)
class Request:
    """What a person asked for."""

    rig: str
    scene: str | None
    seconds: float | None
    json_file: Path | None
    viewer: str | None
    overrides: tuple[str, ...]
    ends_when: Callable[[Supervisor], bool] = lambda _supervisor: False


class Run:
    """Follows the supervisor: shows it, measures it, ends it when the time is over."""

    def __init__(self, request: Request, display: StatusDisplay) -> None:
        self._request = request
        self._display = display
        self.report: run_report.RunReport | None = None

    def turn(self, supervisor: Supervisor, now_s: float) -> bool:
        """Take a turn; return whether the time is over."""
        if self.report is None:
            self.report = run_report.RunReport(supervisor)
        self.report.turn(now_s)
        self._display.turn(supervisor)
        seconds = self._request.seconds
        is_over = seconds is not None and self.report.measured_s >= seconds
        return is_over or self._request.ends_when(supervisor)


def run_up(request: Request, nursery: Nursery) -> None:
    """Start the rig, stay until it ends, write the report whatever ended it."""
    targets.look_at_file("--json", request.json_file)
    options = Options(request.rig, request.scene, (*request.overrides, *_viewer(request.viewer)))
    validation.validate(request.rig, request.scene, request.overrides)
    rig = config.load_rig(request.rig, request.overrides)
    scenario_of(request.scene or rig.scene, rig.training.scenario)
    process = session.open_session(options)
    display = StatusDisplay()
    run = Run(request, display)
    reproach = build.reproach()
    asked = session.SessionOptions(
        options, on_event=display.event, on_turn=run.turn, remarks=(reproach,) if reproach else (), nursery=nursery
    )
    try:
        with display:
            session.run_session(process, asked)
    finally:
        process.bus.close()
        if request.json_file is not None and run.report is not None:
            targets.write_text("--json", request.json_file, run_report.as_text(run.report.result()))


def _viewer(viewer: str | None) -> tuple[str, ...]:
    if viewer is None:
        return ()
    if viewer == "native":
        _need_display()
    if viewer == "none":
        return ("visualization.viewer=none", "processes.visualization.enabled=false")
    return (f"visualization.viewer={viewer}",)


def _need_display() -> None:
    import os

    if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise DeviceError("--viewer native: there is no display (neither DISPLAY nor WAYLAND_DISPLAY is set)")
