"""Input devices of any maker: what nobody touches moves nothing, what is let go stops, what cannot be used is named.

The devices are made up: ranges, places of rest, noise, drift, values before the first report, lost events, releases
that are not reported. A hand of the rig is on them, and the judge looks only at where its tool is.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
import pytest
from evdev import AbsInfo, ecodes
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.gateway.hands import input_stand_in
from tests.gateway.hands.input_stand_in import InputStandIn
from tests.gateway.hands.test_steering import MOUNT, PORT, RESTING
from trocar.services.gateway import drivers
from trocar.services.gateway.devices.driver import Place
from trocar.services.gateway.hands.steering import SteeredArm, SteeredGrasp, shaft_axes
from trocar.services.runtime.config.rig import DriverSettings

STICKS = (("ABS_X", "ABS_Y"), ("ABS_RX", "ABS_RY"), ("ABS_Z", "ABS_RZ"))
RANGES = ((0, 255), (0, 1023), (0, 65535), (-128, 127), (-32768, 32767), (-32767, 32767), (0, 4095), (1, 254))
STEP, REPORT_EVERY = 4, 8  # ticks
INSTANCES = int(os.environ.get("TROCAR_INSTANCES", "15"))  # of each kind
STILL_M = 1e-4
TOUCHED_M = 2e-3


@dataclass(frozen=True)
class MadeUp:
    """An axis: where it rests as a share of its range, its noise, its drift a second, and whether the kernel knows.

    Attributes
    ----------
    first_word
        Tick of its first report, 0 if the kernel has its value when it is opened.
    """

    code: str
    low: int
    high: int
    rest: float
    noise: float = 0.0
    drift: float = 0.0
    first_word: int = 0

    def value(self, share: float) -> int:
        return round(self.low + min(max(share, 0.0), 1.0) * (self.high - self.low))

    def info(self) -> AbsInfo:
        return AbsInfo(self.value(self.rest) if self.first_word == 0 else 0, self.low, self.high, 0, 0, 0)

    def untouched(self, tick: int, rng: np.random.Generator) -> float:
        return self.rest + self.noise * rng.uniform(-1.0, 1.0) + self.drift * 1e-3 * tick


def device(axes: list[MadeUp], buttons: list[int]) -> InputStandIn:
    keys = [ecodes.BTN_SOUTH, ecodes.BTN_EAST, ecodes.BTN_TL, ecodes.BTN_TR, *buttons]
    rows = [(ecodes.ecodes[axis.code], axis.info()) for axis in axes]
    return InputStandIn("/dev/input/event5", "made-up pad", {ecodes.EV_KEY: keys, ecodes.EV_ABS: rows})


@st.composite
def axes(draw: st.DrawFn, codes: tuple[str, ...], rests: st.SearchStrategy[float]) -> list[MadeUp]:
    low, high = draw(st.sampled_from(RANGES))
    first_word = draw(st.sampled_from((0, 0, 5, 40, RESTING + 200)))
    noise, drift = draw(st.sampled_from((0.0, 0.004, 0.02))), draw(st.floats(-0.01, 0.01))
    return [MadeUp(code, low, high, draw(rests), noise, drift, first_word) for code in codes]


@st.composite
def pads(draw: st.DrawFn) -> tuple[list[MadeUp], bool]:
    """A pad: two sticks and two triggers, on whichever of the codes, and whether triggers rest at their high end.

    Where the kernel's 0 is no trigger's place of rest, its first report comes soon after the opening, as the kernel
    then begins to ask the device: later nobody could tell it from a press.
    """
    middle = st.floats(0.40, 0.60)
    right, triggers = draw(st.permutations(STICKS[1:]))
    if draw(st.booleans()):
        triggers = ("ABS_BRAKE", "ABS_GAS")
    is_high = draw(st.booleans())
    made = draw(axes(STICKS[0], middle)) + draw(axes(right, middle))
    last = draw(axes(triggers, st.just(1.0) if is_high else st.just(0.0)))
    if is_high or last[0].low < 0:
        last = [replace(axis, first_word=min(axis.first_word, 40)) for axis in last]
    return made + last, is_high


class Person:
    """A hand of the rig on a device, without the rig: where its tool goes, and how far its jaws are open."""

    def __init__(self, kind: str, source: InputStandIn, index: int = 0) -> None:
        place = Place("left", MOUNT, PORT, index=index)
        arm = drivers.load_arm(DriverSettings(driver=kind), place)
        grasp = drivers.load_grasp(DriverSettings(driver=f"grasp_{kind}"), place)
        assert isinstance(arm, SteeredArm)
        assert isinstance(grasp, SteeredGrasp)
        self.arm, self.grasp, self.source, self.tick = arm, grasp, source, 0
        with input_stand_in.only(source):
            self.arm.open()
            self.grasp.open()
        self.way = shaft_axes(self.arm.target, np.array(PORT))

    def step(self) -> None:
        """Let a look of the arm pass, 4 ms."""
        self.tick += STEP
        self.arm.move_target(1_000_000 * self.tick, 1e-3 * STEP)
        self.opening = self.grasp.opening(1_000_000 * self.tick)

    def moved_m(self, ticks: int, report: Callable[[int], None]) -> np.ndarray:
        """Return how far the tool went right, up and inward, and turned in rad, in so many ticks."""
        began, roll = self.arm.target.copy(), self.arm.target_roll
        for _ in range(ticks // STEP):
            if self.tick % REPORT_EVERY == 0:
                report(self.tick)
            self.step()
        return np.array([*(self.way @ (self.arm.target - began)), self.arm.target_roll - roll])

    def close(self) -> None:
        self.arm.close()
        self.grasp.close()


@contextmanager
def person(kind: str, source: InputStandIn, index: int = 0) -> Iterator[Person]:
    one = Person(kind, source, index)
    yield one
    one.close()


def reporter(
    source: InputStandIn, made: list[MadeUp], seed: int, held: dict[str, float] | None = None
) -> Callable[[int], None]:
    """Return who says, at a tick, where the axes are: at rest, or held at a share of their range."""
    rng, held = np.random.default_rng(seed), held or {}

    def report(tick: int) -> None:
        shares = {axis.code: axis.untouched(tick, rng) for axis in made if tick >= axis.first_word}
        say(source, made, shares | {code: share for code, share in held.items() if code in shares})

    return report


def say(pad: InputStandIn, made: list[MadeUp], shares: dict[str, float]) -> None:
    """Report as the kernel does: only what has changed, and then the end of the report."""
    for axis in made:
        code = ecodes.ecodes[axis.code]
        value = axis.value(shares[axis.code]) if axis.code in shares else pad.absinfo(code).value
        if value != pad.absinfo(code).value:
            pad.say(axis.code, value)


@pytest.mark.parametrize("index", [0, 1])
@given(pad=pads(), seed=st.integers(0, 1 << 30))
@settings(max_examples=INSTANCES, deadline=None)
def test_a_pad_that_nobody_touches_moves_nothing(index: int, pad: tuple[list[MadeUp], bool], seed: int) -> None:
    made, _ = pad
    source = device(made, [])
    with person("gamepad", source, index) as one:
        moved = one.moved_m(1600, reporter(source, made, seed))
        assert np.abs(moved).max() < STILL_M
        assert one.opening is None, "nobody has touched the trigger"
        assert (one.arm.fault, one.arm.prompt, one.grasp.prompt) == ("", "", "")


@pytest.mark.parametrize("index", [0, 1])
@given(pad=pads(), seed=st.integers(0, 1 << 30), way=st.sampled_from((0.0, 1.0)))
@settings(max_examples=INSTANCES, deadline=None)
def test_what_a_person_pushes_goes_its_way_and_stops_when_it_is_let_go(
    index: int, pad: tuple[list[MadeUp], bool], seed: int, way: float
) -> None:
    made, is_high = pad
    source = device([replace(axis, first_word=0) for axis in made], [])
    stick, trigger = made[2 * index], made[4 + index]
    pressed = {trigger.code: 0.05 if is_high else 0.95}
    with person("gamepad", source, index) as one:
        one.moved_m(400, reporter(source, made, seed))
        one.moved_m(80, reporter(source, made, seed, pressed))  # one that rests at its high end counts after this
        one.moved_m(400, reporter(source, made, seed))
        pushed = one.moved_m(200, reporter(source, made, seed, {stick.code: way} | pressed))
        assert pushed[0] * (way - 0.5) > TOUCHED_M / 2
        assert one.opening is not None
        assert one.opening < 0.2
        one.moved_m(8, reporter(source, made, seed))
        assert np.abs(one.moved_m(400, reporter(source, made, seed))).max() < STILL_M
        assert one.opening > 0.85


@given(
    low_high=st.sampled_from(RANGES),
    code=st.sampled_from(("ABS_X", "ABS_Y", "ABS_HAT0X")),
    rest=st.one_of(st.floats(0.14, 0.26), st.floats(0.74, 0.86), st.none()),
    seed=st.integers(0, 1 << 30),
)
@settings(max_examples=INSTANCES, deadline=None)
def test_an_axis_that_never_rests_or_in_no_place_of_rest_is_named_and_moves_nothing(
    low_high: tuple[int, int], code: str, rest: float | None, seed: int
) -> None:
    made = [MadeUp(code, *low_high, 0.5 if rest is None else rest, 0.4 if rest is None else 0.0)]
    made += [MadeUp(name, 0, 255, 0.5) for name in ("ABS_X", "ABS_Y") if name != code]
    source = device(made, [])
    with person("gamepad", source) as one:
        moved = one.moved_m(3000, reporter(source, made, seed))
        assert np.abs(moved).max() < STILL_M
        assert one.arm.prompt.startswith(f"made-up pad (/dev/input/event5) is not used in part: {code} ")
        assert ("never rests" if rest is None else "neither in its middle nor at an end") in one.arm.prompt


@given(
    pushes=st.lists(
        st.tuples(
            st.sampled_from(("REL_X", "REL_Y", "REL_Z", "REL_RZ")),
            st.integers(0, 600),
            st.integers(40, 400),
            st.sampled_from((-350, -200, 200, 350)),
            st.sampled_from((8, 12, 16)),
        ),
        min_size=1,
        max_size=6,
    )
)
@settings(max_examples=2 * INSTANCES, deadline=None)
def test_a_relative_axis_is_at_zero_60_ms_after_its_own_last_report_whatever_the_others_say(
    pushes: list[tuple[str, int, int, int, int]],
) -> None:
    source = input_stand_in.spacemouse()
    last: dict[str, int] = {}
    with person("spacemouse", source) as one:
        for tick in range(0, 1200, STEP):
            for name, begins, lasts, value, every in pushes:
                if begins <= tick < begins + lasts and (tick - begins) // STEP % (every // STEP) == 0:
                    source.say(name, value)
                    last[name] = tick
            one.step()
            for name in ("REL_X", "REL_Y", "REL_Z", "REL_RZ"):
                pushed = one.arm._source.inputs.value(name) != 0.0
                assert not pushed or tick - last[name] < 60
                assert pushed or name not in last or tick - last[name] > 16


@given(code=st.sampled_from(("BTN_SOUTH", "BTN_EAST", "BTN_TR", "BTN_TL")), held=st.integers(4, 1200))
@settings(max_examples=INSTANCES, deadline=None)
def test_a_button_that_is_down_when_it_is_opened_counts_after_it_was_let_go(code: str, held: int) -> None:
    source = device([MadeUp("ABS_X", 0, 255, 0.5)], [])
    source.pressed = [ecodes.ecodes[code]]
    with person("gamepad", source, 1) as one:
        assert np.abs(one.moved_m(held, lambda _tick: None)).max() < STILL_M
        source.say(code, 0)
        one.step()
        source.say(code, 1)
        assert np.abs(one.moved_m(200, lambda _tick: None)).max() > TOUCHED_M


@given(axis=st.sampled_from(("ABS_X", "ABS_Y")), value=st.integers(-32768, 32767), pressed=st.booleans())
@settings(max_examples=INSTANCES, deadline=None)
def test_after_lost_events_the_device_is_asked(axis: str, value: int, pressed: bool) -> None:
    source = input_stand_in.gamepad()
    with person("gamepad", source) as one:
        one.moved_m(400, lambda _tick: None)
        source.say(axis, 32767)
        one.step()
        source.run_over(axis, value, ["BTN_EAST"] if pressed else [])
        one.step()
        inputs = one.arm._source.inputs
        assert inputs.value(axis) == pytest.approx(value / 32768.0, abs=1e-3)
        assert inputs.value("BTN_EAST") == float(pressed)


def test_a_stick_that_was_held_while_it_was_opened_is_named_and_is_one_again_when_it_rests() -> None:
    made = [MadeUp("ABS_X", 0, 255, 0.5), MadeUp("ABS_Y", 0, 255, 0.5)]
    source = device([replace(made[0], rest=1.0), made[1]], [])
    with person("gamepad", source) as one:
        held = one.moved_m(400, reporter(source, made, 0, {"ABS_X": 1.0}))
        assert "ABS_X rests at an end: let go of it" in one.arm.prompt
        let_go = one.moved_m(2000, reporter(source, made, 0))
        assert np.abs([held, let_go]).max() < STILL_M
        assert one.arm.prompt == ""
        assert one.moved_m(200, reporter(source, made, 0, {"ABS_X": 1.0}))[0] > TOUCHED_M


def test_a_cap_that_is_stuck_is_named_and_moves_nothing_more() -> None:
    source = input_stand_in.spacemouse()
    with person("spacemouse", source) as one:
        one.moved_m(6000, lambda _tick: source.say("REL_Y", -300))
        assert one.arm.prompt.endswith("event6) is not used in part: REL_Y never rests: let go of it")
        assert np.abs(one.moved_m(400, lambda _tick: source.say("REL_Y", -300))).max() < STILL_M
        one.moved_m(200, lambda _tick: None)
        assert one.arm.prompt == ""
        assert one.moved_m(200, lambda _tick: source.say("REL_Y", -300))[2] > TOUCHED_M
