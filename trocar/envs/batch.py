"""Many scenes of one environment with Gymnasium's vector interface; scenes of one process share their duct."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space, concatenate, create_empty_array, iterate

from trocar.envs.groups import Group, GroupElsewhere, GroupHere, GroupOnCluster, Made, Moment, connect
from trocar.services.messages.extras import how_to_get
from trocar.services.runtime.errors import ConfigError

Bools = npt.NDArray[np.bool_]


class Batch(VectorEnv[Any, Any, Any]):
    """Scenes that are stepped together; each does to the bit what an environment of its own would do.

    The scenes of a process share basis, residual compliance and mesh of their duct, and the cache of the residual; a
    scene itself takes some 15 MB. With several jobs or a cluster, each gets a group of scenes that follow each other.

        envs = gymnasium.make_vec("trocar/Insertion-v0", 8)  # or Batch("trocar/Insertion-v0", 8, jobs=2)

    Raises ConfigError: one sentence, if an argument is invalid; ConnectionError: no scheduler answers at the address.

    Args:
        environment: str. Registered name, as for ``gymnasium.make``.
        num_envs: int. Number of scenes.
        jobs: int. Number of processes, at most one for each scene; 1 for none beside this one.
        scheduler: str, optional. Address of a Dask scheduler, whose workers take a group each; ``jobs`` has no effect.
        autoreset_mode: AutoresetMode or str. When a scene whose episode has ended starts the next one.
        settings: Arguments of the environment, such as those of `Insertion`.
    """

    def __init__(
        self,
        environment: str,
        num_envs: int = 1,
        *,
        jobs: int = 1,
        scheduler: str | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        **settings: Any,
    ) -> None:
        for name, number in (("num_envs", num_envs), ("jobs", jobs)):
            if type(number) is not int or number < 1:
                raise ConfigError(f"{name}: must be a whole number from 1 on, is {number!r}")
        self.num_envs, self._mode = num_envs, AutoresetMode(autoreset_mode)
        self._groups: list[Group] = []
        self._client: Any = None
        known = {name: value for name, value in settings.items() if value is not None}
        self._places = self._open(Made(environment, num_envs, known, self._mode), jobs, scheduler)
        self._declare()
        self._ended: Bools = np.zeros(num_envs, np.bool_)
        self._seen: list[Any] = [None] * num_envs
        self._observations: Any = create_empty_array(self.single_observation_space, num_envs)

    def _open(self, made: Made, jobs: int, scheduler: str | None) -> list[range]:
        """Start the groups; return the scenes of each."""
        workers: list[str] = []
        if scheduler is not None:
            try:
                self._client, workers = connect(scheduler)
            except ModuleNotFoundError as error:
                raise ConfigError(f"scheduler: needs the package 'distributed': {how_to_get(error.name)}") from None
        n = min(len(workers) or jobs, made.n)
        edges = np.linspace(0, made.n, n + 1).round().astype(int).tolist()
        places = [range(first, end) for first, end in itertools.pairwise(edges)]
        for k, place in enumerate(places):
            part = Made(made.environment, len(place), made.settings, made.autoreset)
            if self._client is not None:
                self._groups.append(GroupOnCluster(part, self._client, workers[k]))
            else:
                self._groups.append(GroupHere(part) if n == 1 else GroupElsewhere(part))
        return places

    def _declare(self) -> None:
        """Declare the spaces, once every group has built its scenes: a first start compiles in each of them."""
        try:
            described = self._ask_all("describe", [()] * len(self._groups))
        except BaseException:
            self.close()
            raise
        self.single_observation_space, self.single_action_space, metadata, self.render_mode = described[0]
        self.metadata = {**metadata, "autoreset_mode": self._mode}
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)

    def _ask_all(self, method: str, arguments: Sequence[tuple[Any, ...]]) -> list[Any]:
        """Call a method of all groups at once; return what each returns, in their order.

        Every answer is awaited, so that none is taken for that of a later call; then the first error is raised.
        Raises ConfigError if the batch is closed.
        """
        if not self._groups:
            raise ConfigError(f"{method}: the batch is closed")
        answers = [each.begin_call(method, *given) for each, given in zip(self._groups, arguments, strict=True)]
        found, errors = [], []
        for answer in answers:
            try:
                found.append(answer())
            except Exception as error:
                errors.append(error)
        if errors:
            raise errors[0]
        return found

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode of every scene, or of those in the mask ``options["reset_mask"]``.

        Raises ValueError: another number of seeds or of a mask's entries than of scenes.

        Args:
            seed: int, sequence or None. The first scene's seed, which each next one's exceeds by one, or all of them.
        """
        seeds = _seeds(seed, self.num_envs)
        given = dict(options or {})
        mask = np.asarray(given.pop("reset_mask", np.ones(self.num_envs)), np.bool_)
        if mask.shape != (self.num_envs,) or not mask.any():
            raise ValueError(f"reset_mask: wants {self.num_envs} entries of which one is true, is {mask.tolist()}")
        which = [[k for k in place if mask[k]] for place in self._places]
        calls = [
            ([seeds[k] for k in each], given or None, [k - place.start for k in each])
            for each, place in zip(which, self._places, strict=True)
        ]
        found = self._ask_all("reset", calls)
        scenes = [k for each in which for k in each]
        self._ended[scenes] = False
        infos = self._take(scenes, [moment for moments in found for moment in moments])
        return self._observed(), infos

    def step(self, actions: Any) -> tuple[Any, npt.NDArray[np.float64], Bools, Bools, dict[str, Any]]:
        """Apply an action to every scene.

        Raises ValueError if actions have another shape than ``action_space``, or a number that is not finite;
        ConfigError if a scene's episode has ended and nobody starts the next. Nothing has moved then.
        """
        if self._mode is AutoresetMode.DISABLED and self._ended.any():
            raise ConfigError(
                f"step: the episode of scene {int(np.argmax(self._ended))} has ended; the next needs reset"
            )
        numbers = np.asarray(actions)
        if numbers.shape != self.action_space.shape:
            raise ValueError(f"actions: their shape is {numbers.shape}, not {self.action_space.shape}")
        if not np.isfinite(numbers).all():
            at = tuple(np.argwhere(~np.isfinite(numbers))[0].tolist())
            raise ValueError(f"actions: {at} is {numbers[at]}, not a finite number")
        each = list(iterate(self.action_space, numbers))
        found = self._ask_all("step", [(each[place.start : place.stop],) for place in self._places])
        moments: list[Moment] = [moment for moments in found for moment in moments]
        infos = self._take(range(self.num_envs), moments)
        rewards = np.array([moment.reward for moment in moments])
        terminated = np.array([moment.terminated for moment in moments], np.bool_)
        truncated = np.array([moment.truncated for moment in moments], np.bool_)
        self._ended = terminated | truncated
        return self._observed(), rewards, terminated, truncated, infos

    def _take(self, scenes: Sequence[int], moments: Sequence[Moment]) -> dict[str, Any]:
        """Store the observations of these scenes, and return their infos as Gymnasium's vectors with masks."""
        infos: dict[str, Any] = {}
        for k, moment in zip(scenes, moments, strict=True):
            self._seen[k] = moment.observation
            if moment.final is not None:
                infos = self._add_info(infos, dict(zip(("final_obs", "final_info"), moment.final, strict=True)), k)
            infos = self._add_info(infos, moment.info, k)
        return infos

    def _observed(self) -> Any:
        seen = concatenate(self.single_observation_space, self._seen, self._observations)
        return np.array(seen)

    def call(self, name: str, *arguments: Any, **named: Any) -> tuple[Any, ...]:
        """Call a method of every scene, or read an attribute; return the results."""
        found = self._ask_all("call", [(name, arguments, named)] * len(self._groups))
        return tuple(each for part in found for each in part)

    def render(self) -> tuple[Any, ...]:
        """Return the image of every scene."""
        found = self._ask_all("render", [()] * len(self._groups))
        return tuple(each for part in found for each in part)

    def close_extras(self, **_kwargs: Any) -> None:
        """Close all scenes, and end what was started for them."""
        while self._groups:
            self._groups.pop().end_scenes()
        if self._client is not None:
            self._client.close()


def _seeds(seed: int | Sequence[int | None] | None, n: int) -> list[int | None]:
    if seed is None:
        return [None] * n
    if isinstance(seed, int | np.integer):
        return [int(seed) + k for k in range(n)]
    if len(seed) != n:
        raise ValueError(f"seed: {len(seed)} seeds for {n} scenes")
    return list(seed)


def insertions(num_envs: int = 1, **settings: Any) -> Batch:
    """Return a batch of `Insertion`, for ``gymnasium.make_vec``."""
    return Batch("trocar/Insertion-v0", num_envs, **settings)


def navigations(num_envs: int = 1, **settings: Any) -> Batch:
    """Return a batch of `Navigation`, for ``gymnasium.make_vec``."""
    return Batch("trocar/Navigation-v0", num_envs, **settings)
