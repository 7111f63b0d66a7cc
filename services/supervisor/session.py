"""One session of the supervisor, from its options to its end."""

from __future__ import annotations

import gc
import os
import resource
import secrets
import signal
import socket
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path

import trocar.protocol.bodies as bodies
from trocar.services.messages.exit_codes import ExitCode
from trocar.services.recordings.errors import RecordingError
from trocar.services.recordings.place import fault_of_folder
from trocar.services.runtime.bus import endpoints
from trocar.services.runtime.bus.endpoints import lock_holders
from trocar.services.runtime.config import config
from trocar.services.runtime.config.rig import Rig
from trocar.services.runtime.errors import BusError, UserError
from trocar.services.runtime.loop.loop import LoopMeter
from trocar.services.runtime.measures.flight import flight_directory, remove_rings
from trocar.services.runtime.private_directory import make_private
from trocar.services.runtime.process.process import Options, Process, load_process_config, open_process
from trocar.services.runtime.web.web_certificate import Certificate, load_for
from trocar.services.runtime.web.web_host import listen
from trocar.services.start import first_start
from trocar.services.supervisor import frozen_configuration
from trocar.services.supervisor.control.supervisor import Setup, Supervisor
from trocar.services.supervisor.crew.crew import Launch
from trocar.services.supervisor.crew.fork_link import ForkServer
from trocar.services.supervisor.crew.loop_progress import LoopProgress
from trocar.services.supervisor.crew.member import Fault, MemberState
from trocar.services.supervisor.crew.processes import TABLE, ProcessSpec
from trocar.services.supervisor.crew.runqueue_waits import OwnIoThreads
from trocar.services.supervisor.frozen_configuration import ChangedFiles
from trocar.services.supervisor.judge.governor import Level
from trocar.services.supervisor.judge.state_machine import RigState
from trocar.services.supervisor.page.command_socket import CommandSocket
from trocar.services.supervisor.page.page import Page
from trocar.services.supervisor.page.page_place import PageFile
from trocar.services.supervisor.page.school import School

#: A turn without events: five in the time within which a lost process is noticed (`crew._NOTICE_S`).
_TURN_S = 0.02
#: Most open files of a process: the supervisor of a running rig was measured to have 98.
_FILES = 256
STAGES = ("judge", "report", "page")


class StartError(UserError):
    """A process of the rig could not start; with its message and exit code."""

    def __init__(self, sentence: str, exit_code: int) -> None:
        super().__init__(sentence)
        self.exit_code = exit_code


class GivenUpError(StartError):
    """A process of the rig ended in error while the rig continued, such as a recorder with a full disk."""


class InterruptedStartError(UserError):
    """A person, or a service's stop, has ended the rig before it ran, which scripts must not take for a run."""

    exit_code = ExitCode.INTERRUPTED_START


@dataclass(slots=True)
class SessionOptions:
    """Settings and callbacks of a session.

    Args:
        options: Options of the command line, also for the processes.
        table: The processes.
        on_event: Called with every event.
        on_turn: Called after every turn, fifty times a second; True ends the session.
        remarks: Warnings that become events at the start, so that the page shows them too.
        fork_server: Starts the processes; without one, each imports for itself.
        switches: Whether `on_turn` ends the session when the supervisor has a `next_scenario`, which is then run.
        token: Secret that commands of the page must contain.
    """

    options: Options
    table: tuple[ProcessSpec, ...] = TABLE
    on_event: Callable[[bodies.Event], None] | None = None
    on_turn: Callable[[Supervisor, float], bool] = field(default=lambda _supervisor, _now_s: False)
    remarks: tuple[str, ...] = ()
    fork_server: ForkServer | None = None
    switches: bool = False
    token: str = field(default_factory=lambda: secrets.token_urlsafe(16))


def open_session(options: Options) -> Process:
    """Return the open supervisor process.

    Raises UserError if the configuration is invalid, a rig is already running on this transport, the limit of open
    files is too low, or the folder of recordings cannot be used.
    """
    _make_room()
    rig = config.load_rig(options.rig, options.overrides)
    if rig.supervisor.mode == "launch":
        _refuse_second_rig(rig)
        _refuse_folder(rig)
    process = open_process(load_process_config("supervisor", options))
    signal.signal(signal.SIGHUP, signal.getsignal(signal.SIGTERM))  # the terminal was closed
    return process


def _make_room() -> None:
    """Raise the limit of open files as far as needed, in addition to inherited ones."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    needed = _FILES + len(os.listdir("/proc/self/fd"))
    if soft >= needed or soft == resource.RLIM_INFINITY:
        return
    if hard != resource.RLIM_INFINITY and hard < needed:
        raise UserError(f"only {hard} files may be open at once, a rig needs {needed}: `ulimit -n {needed}` allows it")
    resource.setrlimit(resource.RLIMIT_NOFILE, (needed, hard))


def _refuse_second_rig(rig: Rig) -> None:
    if found := lock_holders(rig.transport):
        who = ", ".join(f"{name} (process {pid})" for name, pid in found.items())
        raise BusError(f"a rig is running here already: {who}; `trocar down` ends it")
    endpoints.remove_stale(rig.transport)


def _refuse_folder(rig: Rig) -> None:
    folder = rig.recorder.directory
    fault = fault_of_folder(folder, shared=rig.recorder.shared) if rig.process("recorder").enabled else ""
    if fault:
        raise RecordingError(f"recorder.directory {folder}: {fault}")


def run_session(process: Process, session: SessionOptions) -> None:
    """Run the rig until the process is told to stop or `session.on_turn` ends it.

    Raises UserError if a process cannot start, was given up, or a person ended the rig before it ran, after ending all
    processes.
    """
    setup = _setup(process, session)
    web, certificate = process.rig.supervisor.web, load_for(process.rig)
    sock = listen(
        web.host, web.port, "--set supervisor.web.port=N"
    )  # before anything is started, to report a used port at once
    supervisor = Supervisor(setup, process.bus, time.monotonic(), session.on_event)
    _say_first(supervisor, session, certificate)
    threads = OwnIoThreads()
    supervisor.crew.has_heard_all = threads.are_idle
    files = frozen_configuration.files_of(process.rig, session.options.rig, process.scene_name)
    changed = frozen_configuration.ChangedFiles(files, supervisor.say)
    rings, logs = _rings(process.rig), log_directory(process.rig)
    content = _page_content(process, session, certificate, sock)
    loop_progress = supervisor.crew.loop_progress = LoopProgress(rings)
    with (
        closing(threads),
        closing(loop_progress),
        closing(Page(sock, supervisor, content, logs)) as page,
        closing(CommandSocket(supervisor)) as control,
        closing(School(supervisor, logs)) as school,
    ):
        meter = supervisor.meter = LoopMeter(1.0 / _TURN_S, STAGES)
        process.ready(meter, starts_others=True)
        gc.enable()  # present objects are frozen; a session of days produces some garbage
        try:
            interrupted = (
                not _watch(process, supervisor, (page, control, changed, school), session, meter) and process.stop()
            )
        finally:
            page.end()  # it takes as long as all others together
            school.end()
            while not supervisor.stop_step(time.monotonic()):
                supervisor.crew.wait(_TURN_S)
    if process.rig.supervisor.mode == "launch" and rings is not None:
        remove_rings(endpoints.run_directory(process.rig.transport))
    frozen_configuration.remove(process.rig.transport)
    _raise_fault(supervisor)
    if interrupted:
        raise InterruptedStartError("the rig was asked to end before it ran")


def _say_first(supervisor: Supervisor, session: SessionOptions, certificate: Certificate | None) -> None:
    """Say what a person should know before the rig starts."""
    if supervisor.rig.supervisor.mode == "launch" and (told := first_start.notice()):
        supervisor.start_notice = told
        supervisor.say("info", told)
    for remark in session.remarks:
        supervisor.say("warning", remark)
    if certificate is not None:
        until = f"valid until {certificate.until:%Y-%m-%d}"
        supervisor.say("info", f"page: the certificate's SHA-256 fingerprint is {certificate.fingerprint}, {until}")


def _page_content(
    process: Process, session: SessionOptions, certificate: Certificate | None, sock: socket.socket
) -> PageFile:
    """Return the content of the page's file."""
    return PageFile(
        address=_address(sock, "http" if certificate is None else "https"),
        token=session.token,
        rig=process.rig.model_dump_json(),
        scene=process.scene_name,
        switches=session.switches,
        fingerprint="" if certificate is None else certificate.fingerprint,
        scene_overrides=process.scene_overrides,
        asked=(session.options.rig, session.options.overrides),
    )


def _address(sock: socket.socket, scheme: str) -> str:
    host, port = sock.getsockname()[:2]
    host = "127.0.0.1" if host == "0.0.0.0" else "[::1]" if host == "::" else host
    return f"{scheme}://{host}:{port}/"


def _raise_fault(supervisor: Supervisor) -> None:
    """Raise for the process that could not start, or was given up, if there is one."""
    if supervisor.crew.fatal is not None:
        raise StartError(supervisor.crew.fatal.sentence, supervisor.crew.fatal.exit_code)
    members = supervisor.crew.members.values()
    given_up = [Fault(member.reason, max(1, member.status)) for member in members if member.state is MemberState.FAILED]
    faults = given_up + [member.fault for member in members if member.fault is not None]
    if faults:
        raise GivenUpError(faults[0].sentence, faults[0].exit_code)


def _rings(rig: Rig) -> Path | None:
    """Return the directory of the flight rings, None if there is none."""
    try:
        return flight_directory(endpoints.run_directory(rig.transport))
    except (BusError, OSError):
        return None


def _watch(
    process: Process,
    supervisor: Supervisor,
    lines: tuple[Page, CommandSocket, ChangedFiles, School],
    session: SessionOptions,
    meter: LoopMeter,
) -> bool:
    """Supervise the rig until it is to end; return whether it ever ran."""
    due_ns, ran = time.monotonic_ns(), False
    while not process.stop() and supervisor.crew.fatal is None and not supervisor.crew.ended_by_person:
        began_ns = time.monotonic_ns()
        meter.start(min(due_ns, began_ns), began_ns)  # the end of a process wakes it early
        supervisor.step(began_ns * 1e-9)
        ran = ran or supervisor.state in (RigState.RUNNING, RigState.DEGRADED)
        judged_ns = time.monotonic_ns()
        process.health.send_if_due()
        sent_ns = time.monotonic_ns()
        for line in lines:
            line.run_turn(time.monotonic())  # a stop within the turn makes commands late
        ended_ns = time.monotonic_ns()
        meter.stages_ns = (judged_ns - began_ns, sent_ns - judged_ns, ended_ns - sent_ns)
        meter.finish(ended_ns)
        if session.on_turn(supervisor, began_ns * 1e-9):
            break
        due_ns = time.monotonic_ns() + meter.period_ns
        supervisor.crew.wait(_TURN_S)
    return ran


def _setup(process: Process, session: SessionOptions) -> Setup:
    rig = process.rig
    levels = quality_levels(process.scene_name, process.scene_overrides)
    if rig.supervisor.mode == "attach":
        if session.fork_server is not None:
            session.fork_server.close()  # the processes are run by others
        memory = endpoints.run_directory(rig.transport) / "safe_stop"
        return Setup(rig, session.table, None, levels, safe_stop_file=memory)
    arguments, environment = frozen_configuration.freeze(process)
    table = tuple(replace(spec, environment={**spec.environment, **environment}) for spec in session.table)
    return Setup(rig, table, Launch(arguments, log_directory(rig), session.fork_server), levels)


def quality_levels(scene: str, overrides: Sequence[str] = ()) -> tuple[Level, ...]:
    """Return the quality ladder of a scene file, best level first; other processes check its values.

    Raises ConfigError if there is no such scene, or it is not YAML.
    """
    ladder = config.read_scene(scene, overrides).get("quality")
    rungs = [each for each in ladder if isinstance(each, dict)] if isinstance(ladder, list) else []
    return tuple(map(_level, rungs)) or (Level(),)


def _level(rung: Mapping[str, object]) -> Level:
    measured = (rung.get(key) for key in ("cost_us", "force_error_percent", "motion_error_percent"))
    numbers = (float(each) if isinstance(each, int | float) else None for each in measured)
    return Level(str(rung.get("name", Level().name))[:64], *numbers)


def log_directory(rig: Rig) -> Path:
    """Return the directory of the processes' output, kept until the next start."""
    return make_private(endpoints.run_directory(rig.transport) / "log")
