"""``trocar up``: the supervisor with its status on the terminal, and the report of a run."""

from __future__ import annotations

import secrets
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from urllib.parse import urlsplit

from trocar.services.cli import targets, validation
from trocar.services.cli.attempt import made_of
from trocar.services.cli.moment import request_from
from trocar.services.cli.status_display import StatusDisplay
from trocar.services.runtime.config import config
from trocar.services.runtime.errors import DeviceError, UserError
from trocar.services.runtime.process.process import Options
from trocar.services.supervisor import run_report, session
from trocar.services.supervisor.control.supervisor import Supervisor
from trocar.services.supervisor.crew.fork_link import ForkServer
from trocar.services.training.scenario import scenario_of
from trocar.services.visualization.web import build


@dataclass(frozen=True, slots=True)
class UpRequest:
    """What a person asked for. What ends by itself (`ends_when`) is not switched to another scenario."""

    rig: str
    scene: str | None
    seconds: float | None
    json_file: Path | None
    viewer: str | None
    overrides: tuple[str, ...]
    scenario: str | None = None
    ends_when: Callable[[Supervisor], bool] | None = None

    def options(self) -> Options:
        """Return the options of every process. Raises UserError: one sentence that names what no rig can run with."""
        scene, overrides = self.scene, self.overrides
        if self.scenario is not None:
            scene, overrides = made_of(self.scenario, scene, overrides)
        validation.validate(self.rig, scene, overrides)
        rig = config.load_rig(self.rig, overrides)
        scenario_of(scene or rig.scene, rig.training.scenario)
        return Options(self.rig, scene, (*overrides, *_viewer(self.viewer)))


class Run:
    """Follows the supervisor: shows it, measures it, ends it when the time is over or another scenario is to begin."""

    def __init__(self, request: UpRequest, display: StatusDisplay) -> None:
        self._request = request
        self._display = display
        self.report: run_report.RunReport | None = None
        self.next_scenario = self.next_moment = ""
        self.begins_again = False
        self.port = 0

    def follow_rig(self, supervisor: Supervisor, now_s: float) -> bool:
        """Take a turn; return whether the session is over."""
        if self.report is None:
            self.report = run_report.RunReport(supervisor)
            self.port = urlsplit(supervisor.page_address).port or 0
        self.report.watch_run(now_s)
        self._display.show_state(supervisor)
        self.next_scenario, self.next_moment = supervisor.next_scenario, supervisor.next_moment
        self.begins_again = supervisor.begins_again or bool(self.next_scenario)
        request = self._request
        is_over = request.seconds is not None and self.report.measured_s >= request.seconds
        return is_over or self.begins_again or (request.ends_when is not None and request.ends_when(supervisor))


def run_up(request: UpRequest, fork_server: ForkServer) -> None:
    """Start the rig, stay until it ends, write the report whatever ended it.

    Where the page asks for another scenario that is run next, and where it asks for a new start the same with what its
    files say by then, with the page's address and token as they are. Where it asks for a moment of a recorded attempt,
    that is run next, and what comes after it is as if there had been none. What cannot be run is told, and what ran
    before begins again.
    """
    targets.look_at_file("--json", request.json_file)
    options, token, remarks = request.options(), secrets.token_urlsafe(16), tuple(filter(None, [build.build_fault()]))
    while (run := _run_session(request, options, token, remarks, fork_server)).begins_again:
        fork_server.begin_server()
        name = run.next_scenario
        other = replace(request, scene=None, scenario=name) if name else request
        what = f"scenario {name}" if name else "the moment" if run.next_moment else "the rig"
        try:
            if run.next_moment:
                options, remarks = request_from(request, run.next_moment).options(), ()
            else:
                options, request, remarks = other.options(), other, ()
        except UserError as error:
            remarks = (f"{what} cannot be run: {error}",)
        options = replace(options, overrides=(*options.overrides, f"supervisor.web.port={run.port}"))


def _run_session(
    request: UpRequest, options: Options, token: str, remarks: tuple[str, ...], fork_server: ForkServer
) -> Run:
    process = session.open_session(options)
    display = StatusDisplay()
    run = Run(request, display)
    asked = session.SessionOptions(
        options, on_event=display.event, on_turn=run.follow_rig, remarks=remarks, fork_server=fork_server,
        switches=request.ends_when is None and process.rig.supervisor.mode == "launch", token=token,
    )  # fmt: skip
    try:
        with display:
            session.run_session(process, asked)
        if process.stop():  # by a person at the terminal, while the rig was ending for another scenario
            run.begins_again = False
    finally:
        process.bus.close()
        if request.json_file is not None and run.report is not None:
            targets.write_text("--json", request.json_file, run_report.as_text(run.report.result()))
    return run


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
