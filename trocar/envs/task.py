"""Base of the environments: a scene, hands that move at rates, and the procedure that judges an episode."""

from __future__ import annotations

import os
from abc import abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypedDict

import gymnasium
import numpy as np
from gymnasium import spaces

import trocar
from trocar.envs.ducts import Ducts
from trocar.envs.episode import FAST, Episode, Verdict
from trocar.envs.hands import DeviceHands
from trocar.envs.randomisation import Bound, Randomisation
from trocar.envs.stage import Stage
from trocar.envs.state import View
from trocar.protocol.topics import TICK_S
from trocar.review.export.pictures import Camera
from trocar.services.mechanics.arrays import Float32Array, FloatArray
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.runtime.errors import ConfigError
from trocar.services.training.scenario import Scenario, load_scenario
from trocar.services.training.score import load_rules
from trocar.services.training.situation import EVERY_TICKS

_MOST_TICKS = 40
"""Most ticks between two observations of the procedure, as in a recording at 25 Hz."""


class TaskOptions(TypedDict, total=False):
    """Options of `Task` beside scenario and observation."""

    quality: int | None
    overrides: tuple[str, ...]
    randomise: Mapping[str, tuple[Bound, Bound]] | None
    record: str | Path | None
    step_s: float
    image_size: tuple[int, int]
    render_mode: str | None
    ducts: Ducts | None


class Task(gymnasium.Env[Any, Any]):
    """A scenario as an environment; derived classes define actions and observations.

    The reward of a step is the progress towards the goal, as a fraction of its depth, plus 1 for success, minus 1 for
    failure. ``info`` has ``is_success``, ``cost`` (penalties of this step's errors by the rules of the score, in s) and
    the state by the procedure. Raises ConfigError: one sentence, if an argument is invalid.

    Args:
        scenario: str or Path. Goal, limits and scene: a name in configs/scenarios, or a file.
        observation: {"state", "image"}
        quality: int, optional. Quality level of the scene; None for the last.
        overrides: sequence of str. ``key=value`` of the scene, after the scenario's.
        randomise: mapping, optional. Keys of the scene and their ranges, drawn at each reset, see `Randomisation`.
        record: str or Path, optional. Folder for a recording of each episode.
        step_s: float. Duration of an action, a multiple of 4 ms up to 40; the procedure observes once a step.
        image_size: tuple of int. Width and height.
        render_mode: {"rgb_array"}, optional
        ducts: Ducts, optional. Where its duct is kept; None for the ducts of the process, which all environments share.

    Attributes:
        hands: DeviceHands. The hands, moved by actions.
        scenario: Scenario. The scenario with the episode's goal.
        step_s: float
    """

    metadata = {  # noqa: RUF012
        "render_modes": ["rgb_array"],
        "render_fps": 50,
    }
    view_name = "scope"
    """View of the image, see `Camera`."""

    def __init__(
        self,
        scenario: str | Path,
        observation: str = "state",
        *,
        quality: int | None = None,
        overrides: tuple[str, ...] = (),
        randomise: Mapping[str, tuple[Bound, Bound]] | None = None,
        record: str | Path | None = None,
        step_s: float = 0.02,
        image_size: tuple[int, int] = (96, 96),
        render_mode: str | None = None,
        ducts: Ducts | None = None,
    ) -> None:
        self.render_mode = render_mode
        self._ticks = _ticks_of(step_s)
        self.step_s = self._ticks * TICK_S
        self.scenario, self._rules = load_scenario(scenario), load_rules()
        fixed = (*self.scenario.set, *overrides)
        self._randomisation = Randomisation(self.scenario.scene, randomise or {}, fixed)
        self._stage = Stage(self.scenario.scene, fixed, quality, ducts)
        self._image_size = image_size
        self._record = Path(record) if record is not None else None
        self._camera: Camera | None = None
        self._episode: Episode | None = None
        self._episodes = 0
        self._verdict = Verdict()
        self._is_image = _is_image(observation)

    def _declare(self, shape: tuple[int, ...], most: Float32Array) -> None:
        """Declare actions of this shape in [-1, 1], and observations: numbers up to ``most`` in size, or images."""
        self.action_space = spaces.Box(-1.0, 1.0, shape, np.float32)
        width, height = self._image_size
        image = spaces.Box(0, 255, (height, width, 3), np.uint8)
        self.observation_space = image if self._is_image else spaces.Box(-most, most, dtype=np.float32)

    @abstractmethod
    def action_of(self, rates: FloatArray) -> FloatArray:
        """Return the action of hands at these rates (tools, 5), as fractions of the limits."""

    @abstractmethod
    def _rates_of(self, action: FloatArray) -> FloatArray:
        """Return the rates (tools, 5) of an action, each from -1 to 1 of the limits."""

    @abstractmethod
    def _new_hands(self) -> DeviceHands:
        """Return the hands for a new episode."""

    @abstractmethod
    def _new_view(self) -> View:
        """Return the reader of observations for a new episode."""

    @abstractmethod
    def _way_m(self) -> float:
        """Return the progress along the path to the goal."""

    def _draw_task(self) -> dict[str, str]:
        """Draw the task of the next episode; return its values for ``info``."""
        return {}

    def _asked(self) -> Scenario:
        """Return the scenario of a new episode."""
        return self.scenario

    @property
    def simulation(self) -> trocar.Simulation:
        """The simulation, for inspection."""
        return self._stage.simulation

    @property
    def view(self) -> View:
        """The reader of numerical observations in this episode."""
        return self._view

    @property
    def depth_m(self) -> float:
        """Depth of the catheter: its length in the lumen, or the tip's distance along the path to the goal's branch."""
        return self._verdict.depth_m

    @property
    def held(self) -> list[trocar.GraspHold]:
        """The holds of the tools."""
        return self._stage.grips.holds

    @property
    def time_s(self) -> float:
        """Simulated time of the episode."""
        return self._episode.time_s if self._episode is not None else 0.0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start an episode; ``info["drawn"]`` has the drawn values of the scene."""
        super().reset(seed=seed)
        self._end_episode()
        before = self._stage.duct
        drawn = self._randomisation.draw(self.np_random)
        asked = self._draw_task()
        named = tuple(f"{key}={value}" for key, value in asked.items())
        simulation = self._stage.begin_episode((*self._randomisation.overrides(drawn), *named))
        if self._stage.duct is not before:
            self._close_camera()
        self._mouth_m = np.array(self._stage.site.mouth_m)
        self.scenario = self._asked()
        self.hands = self._new_hands()
        start = ToolInputs()
        trocar.expert(simulation).write_inputs(0.0, start)
        self.hands.set_start(start)
        self._view = self._new_view()
        self._episode = Episode(self._stage, self.hands, self.scenario, self._rules, self._new_path())
        self._verdict = self._episode.verdict()
        self._potential_m = self._way_m()
        return self._observe(), {"drawn": drawn, **asked}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Apply an action for ``step_s``.

        Raises ValueError if the action has another shape than ``action_space``, or a number that is not finite; nothing
        has moved then.
        """
        if self._episode is None:
            raise ConfigError("step: an episode begins with reset")
        self.hands.steer(self._rates_of(self._checked(action)))
        self._episode.advance(self._ticks)
        before, self._verdict = self._verdict, self._episode.verdict()
        verdict, was_m, self._potential_m = self._verdict, self._potential_m, self._way_m()
        outcome = {"success": 1.0, "failure": -1.0}.get(verdict.outcome, 0.0)
        reward = (self._potential_m - was_m) / self.scenario.goal.depth_m + outcome
        info = {
            "is_success": verdict.outcome == "success", "cost": verdict.cost_s - before.cost_s,
            "phase": verdict.phase, "depth_m": verdict.depth_m, "errors": verdict.errors, "time_s": verdict.time_s,
            "outcome": verdict.outcome, "reason": verdict.reason, "score": verdict.score,
        }  # fmt: skip
        return self._observe(), reward, verdict.ended, False, info

    def _checked(self, action: Any) -> FloatArray:
        numbers = np.asarray(action, np.float64)
        if numbers.shape != self.action_space.shape:
            raise ValueError(f"action: its shape is {numbers.shape}, not {self.action_space.shape}")
        if not np.isfinite(numbers).all():
            at = tuple(np.argwhere(~np.isfinite(numbers))[0].tolist())
            raise ValueError(f"action: {at} is {numbers[at]}, not a finite number")
        return numbers

    def leave(self) -> None:
        """End the episode, and close its recording; the next one starts with reset."""
        if self._episode is not None:
            self._episode.close()

    def render(self) -> Any:
        """Return the image (height, width, 3) uint8; None without a render mode."""
        return self._image() if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """Close the present recording, and the renderer."""
        self._end_episode()
        self._close_camera()

    def _new_path(self) -> Path | None:
        if self._record is None:
            return None
        while (path := self._record / f"episode-{os.getpid()}-{self._episodes:05d}.mcap").exists():
            self._episodes += 1
        return path

    def _end_episode(self) -> None:
        self.leave()
        self._episode = None

    def _close_camera(self) -> None:
        if self._camera is not None:
            self._camera.close()
            self._camera = None

    def _observe(self) -> Any:
        if self._is_image or self._episode is None:
            return self._image()
        return self._view.read(*(self._episode.frames[topic].body for topic in FAST))

    def _image(self) -> Any:
        if self._episode is None:
            raise ConfigError("render: an episode begins with reset")
        if self._camera is None:
            stage = self._stage
            self._camera = Camera(stage.scene, str(stage.name), stage.duct, self._image_size, self.view_name)
        return self._camera.image(self._episode.frames)

    def _to_mouth_m(self) -> float:
        """Return the distance of the tip from the mouth, 0 if it is inside."""
        if self._verdict.depth_m > 0.0:
            return 0.0
        return float(np.linalg.norm(self.simulation.catheter.state.position_m[-1] - self._mouth_m))


def _ticks_of(step_s: float) -> int:
    ticks = round(step_s / TICK_S)
    if not 0 < ticks <= _MOST_TICKS or ticks % EVERY_TICKS or abs(ticks * TICK_S - step_s) > 1e-9:
        raise ConfigError(f"step_s: must be a multiple of {EVERY_TICKS} ms up to {_MOST_TICKS}, is {step_s:g} s")
    return ticks


def _is_image(observation: str) -> bool:
    if observation not in ("state", "image"):
        raise ConfigError(f"observation: must be state or image, is {observation!r}")
    return observation == "image"
