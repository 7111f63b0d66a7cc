"""The rig file: processes and their hosts, transport, devices, and contracts."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, field_validator, model_validator

from trocar.protocol.topics import TOPICS, observed_by, read_by
from trocar.services.messages.nearest_word import did_you_mean
from trocar.services.runtime.config.bounds import Core, Metres, Port, Priority, Share, Torque, Turn, between

LOOPBACK = ("127.0.0.1", "localhost", "::1")
#: Viewers for which the picture's process serves browsers.
_SERVED = ("web", "auto")
#: Drivers of arms without force feedback: the hand that moves one feels no late tick.
FORCELESS = ("web", "gamepad", "spacemouse", "replay")
#: Ending of the names of drivers of simulated devices, which no hand holds.
_SIMULATED = "_simulated"


class Settings(BaseModel):
    """Base of every configuration model: unknown keys and wrong types are rejected; immutable."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


def _not_nothing(path: Any) -> Any:
    if path == "":  # would be the present folder
        raise ValueError("is empty; the present folder is called '.'")
    return path


def _a_file_can_have_it(name: str) -> str:
    if "/" in name or not name.isprintable() or name.startswith("."):
        raise ValueError(f"recordings are called after it: {name!r} holds '/', a line's end, or begins with '.'")
    return name


def _not_every_interface(host: str) -> str:
    if not host.strip():  # would bind every interface of the machine
        raise ValueError("is empty; all addresses of this host are called 0.0.0.0")
    return host


def _one_of(kind: str, known: Iterable[str]) -> AfterValidator:
    names = tuple(dict.fromkeys(known))

    def check(name: str) -> str:
        if name not in names:
            raise ValueError(f"there is no {kind} {name!r}; known: {', '.join(names)}{did_you_mean(name, names)}")
        return name

    return AfterValidator(check)


def _not_empty(values: Any) -> Any:
    if not values:
        raise ValueError("is empty: leave the key out where nothing is to be said")
    return values


_A_LOOK = "what fails has to be noticed while a person still looks"
_WATCHED = between(0.0, 60.0, "s", _A_LOOK)
_LATENCY = between(1.0, 6e7, "us", "a minute is judged at a time, and no frame arrives within a microsecond")
_A_WEEK = 604_800.0  # its nanoseconds are whole numbers of 64-bit floats, as those of up to 104 days are
Vector3 = tuple[Metres, Metres, Metres]
NamedPath = Annotated[Path, BeforeValidator(_not_nothing)]
Name = Annotated[str, Field(min_length=1, max_length=64), AfterValidator(_a_file_can_have_it)]
Host = Annotated[str, AfterValidator(_not_every_interface)]
ProcessName = Annotated[str, _one_of("process", (row.publisher for row in TOPICS.values()))]


class Transport(Settings):
    """Transport of frames: ipc on one host, tcp across hosts or containers."""

    kind: Literal["ipc", "tcp"] = "ipc"
    directory: NamedPath | None = Field(None, description="folder of the ipc sockets; by default private to the user")
    base_port: Annotated[int, between(1024, 57_000, "", "ports below are the system's, and the streams' lie above")] = (
        21000
    )
    host: Host = Field("127.0.0.1", description="tcp: where publishers are reached")
    hosts: dict[ProcessName, Host] = Field({}, description="tcp: address of each publisher that is not at `host`")
    bind_host: Host = Field("127.0.0.1", description="tcp: address that publishers bind")
    keys: NamedPath | None = Field(None, description="tcp: directory of the rig's keys, made by `trocar keys`")
    insecure: bool = Field(False, description="allow tcp beyond loopback without keys")

    @model_validator(mode="after")
    def _protected_beyond_loopback(self) -> Self:
        beyond = [h for h in (self.host, self.bind_host, *self.hosts.values()) if h not in LOOPBACK]
        if self.kind == "tcp" and beyond and self.keys is None and not self.insecure:
            raise ValueError(
                f"tcp to {beyond[0]} leaves this host unprotected: name the directory of `trocar keys` as `keys`, "
                "or set `insecure: true` to accept that"
            )
        if self.kind == "ipc" and self.keys is not None:
            raise ValueError("keys protect tcp; the sockets of ipc belong to this user alone")
        return self

    def address(self, process: str) -> str:
        """Return the tcp address of a process."""
        return self.hosts.get(process, self.host)

    def shares_host(self, one: str, other: str) -> bool:
        """Return whether two processes are on one host; one without a name may be anywhere."""
        near = bool(one) and self.address(one) == self.address(other) not in LOOPBACK
        return near or self.kind == "ipc"


PATH_OWNERS = {
    "servo": "gateway",
    "grasp": "gateway",
    "device_model": "haptics",
    "device_force": "haptics",
    "device_pixel": "visualization",
}
"""All measured paths, each with the process that dominates it and is acted on when it is too slow."""


PathName = Annotated[str, _one_of("path", PATH_OWNERS)]
#: The loops that take each tick of the rig's time together.
_IN_STEP = ("gateway", "haptics", "physics")


class ProcessSettings(Settings):
    """Placement and scheduling of one process."""

    enabled: bool = True
    core: Core | None = None
    priority: Priority | None = Field(None, description="of SCHED_FIFO; none: ordinary class")
    nice: Annotated[int, between(-20, 19, "", "Linux has no other")] | None = None
    share: Annotated[float, between(1e-3, 0.95, "", "the kernel keeps 5 % of a core, and no loop runs with less")] = (
        Field(0.3, description="of a core, that a real-time budget of its group must cover")
    )
    restart: bool = Field(True, description="whether the supervisor restarts it when it dies or hangs")
    critical: bool = Field(True, description="whether the rig cannot run without it")


class DriverSettings(Settings):
    """A driver by name (a file of services/gateway/drivers), the device file it uses, and settings of this rig."""

    driver: str
    device: str | None = Field(None, description="a file of configs/devices, without .yaml")
    settings: dict[str, Any] = {}


class Mount(Settings):
    """Position and yaw of an upright arm in the world."""

    centre_m: Vector3 = Field((0.0, 0.0, 0.0), description="world position of the middle of the arm's workspace")
    yaw_rad: Turn = 0.0


class InstrumentSettings(Settings):
    """One laparoscopic instrument: a force-feedback arm, a handle, a port."""

    name: Annotated[str, Field(min_length=1, max_length=64)]
    port_m: Vector3 = Field(description="the trocar's fixed point in the world")
    mount: Mount = Mount()
    arm: DriverSettings
    grasp: DriverSettings | None = None


class GatewaySettings(Settings):
    """The devices and the servo's limits."""

    instruments: Annotated[tuple[InstrumentSettings, ...], Field(max_length=8)] = ()
    force_limit_n: Annotated[
        float, between(0.01, 20.0, "N", "no instrument pushes a hand harder, and less is not felt")
    ] = 3.0
    force_rate_limit_n_s: Annotated[
        float, between(0.1, 1e5, "N/s", "no arm's motor is faster, and no hand so slow")
    ] = 200.0
    grasp_torque_limit_nm: Torque = 0.3
    engage_ramp_s: Annotated[float, _WATCHED] = 0.5
    supervisor_timeout_s: (
        Annotated[float, between(0.5, 60.0, "s", f"{_A_LOOK}, and a busy host is no fault")] | None
    ) = Field(2.0, description="every hand is released when the supervisor has been silent for so long; null: no limit")

    @field_validator("instruments")
    @classmethod
    def _are_told_apart(cls, instruments: tuple[InstrumentSettings, ...]) -> tuple[InstrumentSettings, ...]:
        names = [each.name for each in instruments]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:  # their gauges, such as a lost link or a hot motor, would collide
            raise ValueError(f"two instruments are called {twice!r}")
        return instruments


class ViewSettings(Settings):
    """The picture.

    `viewer`: "web" draws in the browser, "native" in a window of this host, "auto" in a window where there is a
    display, "none" not at all.
    """

    viewer: Literal["auto", "web", "native", "none"] = "web"
    rate_hz: Annotated[
        float, between(10.0, 120.0, "Hz", "a screen shows no more, and less is no motion to the eye")
    ] = 60.0
    host: Host = "127.0.0.1"
    port: Port = 8081


class WebSettings(Settings):
    """The page: view and dashboard."""

    host: Host = "127.0.0.1"
    port: Port = 8080
    keys: NamedPath | None = Field(
        None, description="directory of `trocar keys`: page and picture are encrypted (https) by its certificate"
    )
    insecure: bool = Field(False, description="allow page and picture beyond loopback without encryption")
    class_token: NamedPath | None = Field(
        None, description="file with the token of a class, by which an instructor's desk commands this rig, too"
    )


class LoopContract(Settings):
    """Contract of a loop: an error budget for each minute, and no breakdown."""

    rate_hz: Annotated[
        float, between(0.1, 10_000.0, "Hz", "no loop of the rig is faster, and a minute has to have ticks")
    ]
    miss_ratio: Share = Field(0.01, description="of a minute's ticks that may be late")
    follows_readers: bool = Field(
        False, description="whether its rate may fall to what its readers ask for, as that of a picture"
    )
    stop_miss_ratio: Share = Field(
        0.5, description="of ticks; a loop losing more at lowest quality is restarted, then the rig stopped; 1: never"
    )


class PathContract(Settings):
    """Contract of a latency path, over a minute and recently."""

    p99_us: Annotated[float, _LATENCY]
    stop_p99_us: Annotated[float, _LATENCY] | None = Field(
        None, description="latency beyond which, on the lowest quality, its process is restarted, then the rig stopped"
    )


class SupervisorSettings(Settings):
    """Supervision of the rig."""

    mode: Literal["launch", "attach"] = "launch"
    heartbeat_timeout_s: Annotated[float, between(0.03, 60.0, "s", f"{_A_LOOK}, and a turn of it takes 0.02 s")] = 0.5
    ready_timeout_s: Annotated[
        float, between(0.1, 86_400.0, "s", "nobody waits longer, and no process starts sooner")
    ] = Field(120.0, description="time without progress after which a starting process is ended")
    window_s: Annotated[float, between(0.1, 60.0, "s", "a mean has to follow what happens, and to have ticks")] = Field(
        2.0, description="time over which the dashboard averages"
    )
    backoff_s: Annotated[tuple[Annotated[float, _WATCHED], ...], AfterValidator(_not_empty)] = (
        0.1, 0.5, 1.0, 2.0, 5.0,
    )  # fmt: skip
    max_restarts_per_minute: Annotated[int, between(0, 600, "", "no process starts and ends ten times a second")] = 5
    web: WebSettings = WebSettings()


class Contracts(Settings):
    """Deadlines by loop and by path."""

    loops: dict[ProcessName, LoopContract] = {}
    paths: dict[PathName, PathContract] = {}


class RecorderSettings(Settings):
    """Contents and place of recordings."""

    directory: NamedPath = Path("out/recordings")
    shared: bool = Field(False, description="whether other users may read recordings, subject to the umask")
    whole: tuple[str, ...] = Field(
        ("gateway.state", "supervisor.state"),
        description="topics of which every frame is kept; all else can be recomputed from the device frames",
    )
    sample_rate_hz: Annotated[
        float, between(1.0, 200.0, "Hz", "for more name the topic in `whole`; less is no motion")
    ] = Field(50.0, description="of all other topics")

    @field_validator("whole")
    @classmethod
    def _is_recorded(cls, whole: tuple[str, ...]) -> tuple[str, ...]:
        known = (*read_by("recorder"), *observed_by("recorder"))
        for topic in whole:
            if topic not in known:
                near = did_you_mean(topic, known)
                raise ValueError(f"the recorder does not read {topic!r}; known: {', '.join(known)}{near}")
        return whole


class TrainingSettings(Settings):
    """Scenario of attempts."""

    scenario: str | None = Field(None, description="a file of configs/scenarios; none: the one of the scene, if any")
    again_after_s: (
        Annotated[float, between(1.0, 86_400.0, "s", "a person sees the result, and waits no longer")] | None
    ) = Field(None, description="time after a success until the next attempt begins by itself; none: never")


class ReplaySettings(Settings):
    """A recording that replaces the devices, set by `trocar replay`."""

    file: NamedPath
    rate: Annotated[float, between(0.0, 1000.0, "", "0 is as fast as it goes")] = Field(
        1.0, description="multiple of real time; 0: as fast as possible"
    )
    from_s: Annotated[float, between(0.0, _A_WEEK, "s", "a recording begins at 0, and none lasts longer")] = Field(
        0.0, description="what comes before is simulated as fast as possible; a time in whole ticks of 1 ms"
    )
    until_s: (
        Annotated[float, between(1e-3, _A_WEEK, "s", "no recording lasts longer, and a tick takes 0.001 s")] | None
    ) = Field(None, description="end, a time in whole ticks of 1 ms; none: that of the recording")
    loop: bool = False
    take_over: bool = Field(False, description="whether the rig's own devices take over at the end")


class Rig(Settings):
    """A whole rig file.

    In `simulated` time no tick is ever lost: a late loop slows the rig's time down. No hand may feel a force then,
    as it would feel the same force for too long.
    """

    name: Name
    base: str | None = Field(
        None, description="rig whose values hold unless given here; instruments match by name, other lists are replaced"
    )
    scene: str = "default"
    transport: Transport = Transport()
    processes: dict[ProcessName, ProcessSettings] = {}
    time: Literal["auto", "clock", "simulated"] = Field(
        "auto", description="whether late ticks are lost, or slow the rig's time; auto: `clock` if an arm gives force"
    )
    spare_power: bool = Field(False, description="let the cores sleep between ticks, so that the loops wake later")
    gateway: GatewaySettings = GatewaySettings()
    visualization: ViewSettings = ViewSettings()
    recorder: RecorderSettings = RecorderSettings()
    training: TrainingSettings = TrainingSettings()
    replay: ReplaySettings | None = None
    supervisor: SupervisorSettings = SupervisorSettings()
    contracts: Contracts = Contracts()

    @model_validator(mode="after")
    def _has_a_port_for_each(self) -> Self:
        port, page = self.visualization.port, self.supervisor.web.port
        beside = self._serves_picture() and self.supervisor.mode == "launch"  # otherwise each may have its own host
        if beside and port == page != 0:
            raise ValueError(f"visualization.port: {port} is the page's already (supervisor.web.port)")
        return self

    @model_validator(mode="after")
    def _makes_no_hand_wait(self) -> Self:
        felt = [each for each in self.gateway.instruments if not _may_wait(each.arm.driver)]
        if self.time == "simulated" and felt:
            raise ValueError(f"time: the arm of {felt[0].name!r} gives force to a hand, which cannot wait: say `clock`")
        return self

    @model_validator(mode="after")
    def _is_encrypted_beyond_loopback(self) -> Self:
        web = self.supervisor.web
        served = {"supervisor.web.host": web.host}
        if self._serves_picture():
            served["visualization.host"] = self.visualization.host
        beyond = next((f"{key}: {host}" for key, host in served.items() if host not in LOOPBACK), "")
        if beyond and web.keys is None and not web.insecure:
            raise ValueError(
                f"{beyond} would send the page's token over the network in clear: name the directory of `trocar keys` "
                "as `supervisor.web.keys`, or set `supervisor.web.insecure: true` to accept that"
            )
        return self

    def _serves_picture(self) -> bool:
        return self.process("visualization").enabled and self.visualization.viewer in _SERVED

    def process(self, name: str) -> ProcessSettings:
        """Return the settings of a process, by default those of the model."""
        return self.processes.get(name, ProcessSettings())

    @property
    def simulated_time(self) -> bool:
        """Whether the rig's time waits for late ticks. A replay has a time of its own."""
        arms = [each.arm.driver for each in self.gateway.instruments]
        waits = self.time == "simulated" or (self.time == "auto" and bool(arms) and set(arms) <= set(FORCELESS))
        return waits and self.replay is None

    def in_its_time(self) -> Self:
        """Return the rig without contracts on ticks and latencies that nobody feels, if its time is simulated."""
        if not self.simulated_time:
            return self
        loops = {name: loop for name, loop in self.contracts.loops.items() if name not in _IN_STEP}
        paths = {name: path for name, path in self.contracts.paths.items() if PATH_OWNERS[name] not in _IN_STEP}
        contracts = self.contracts.model_copy(update={"loops": loops, "paths": paths})
        return self.model_copy(update={"contracts": contracts})

    def page_hands(self) -> tuple[str, ...]:
        """Return the names of the instruments that are controlled at the page."""
        return tuple(each.name for each in self.gateway.instruments if each.arm.driver == "web")


def _may_wait(driver: str) -> bool:
    """Return whether no hand feels the force of an arm with this driver."""
    return driver in FORCELESS or driver.endswith(_SIMULATED)
