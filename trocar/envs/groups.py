"""Groups of scenes that one thread steps in turn: in this process, in another one, or on a worker of a Dask cluster."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any, Protocol

import gymnasium
from gymnasium.vector import AutoresetMode

from trocar.envs.ducts import Ducts
from trocar.services.runtime.realtime.autogroup import end_with_parent
from trocar.studies.accuracy.workers import connect_client

Answer = Callable[[], Any]
"""Returns the result of a call when it is there."""
END_S = 5.0
"""Time for a process to end by itself after it was told so."""


@dataclass(frozen=True, slots=True)
class Made:
    """How the environments of a group are made: the registered name, how many, and the arguments of each."""

    environment: str
    n: int
    settings: dict[str, Any]
    autoreset: AutoresetMode


@dataclass(slots=True)
class Moment:
    """What an environment returns of a reset or a step; ``final`` are the last observation and info of an episode."""

    observation: Any
    info: dict[str, Any]
    reward: float = 0.0
    terminated: bool = False
    truncated: bool = False
    final: tuple[Any, dict[str, Any]] | None = None


class Scenes:
    """Environments that share their ducts and the cache of the residual; one thread calls it."""

    def __init__(self, made: Made) -> None:
        shared = Ducts(one_thread=True)
        self.envs = [gymnasium.make(made.environment, ducts=shared, **made.settings) for _ in range(made.n)]
        self._autoreset, self._ended = made.autoreset, [False] * made.n

    def describe(self) -> tuple[gymnasium.Space[Any], gymnasium.Space[Any], dict[str, Any], str | None]:
        """Return the spaces of an observation and an action, the metadata and the render mode of one of them."""
        one = self.envs[0]
        return one.observation_space, one.action_space, dict(one.metadata), one.render_mode

    def reset(self, seeds: Sequence[int | None], options: dict[str, Any] | None, which: Sequence[int]) -> list[Moment]:
        """Start an episode of each of ``which``, with its seed."""
        moments = []
        for k, seed in zip(which, seeds, strict=True):
            self._ended[k] = False
            moments.append(Moment(*self.envs[k].reset(seed=seed, options=options)))
        return moments

    def step(self, actions: Sequence[Any]) -> list[Moment]:
        """Apply an action to each; one whose episode has ended starts the next as the autoreset mode says."""
        return [self._step(k, action) for k, action in enumerate(actions)]

    def _step(self, k: int, action: Any) -> Moment:
        env = self.envs[k]
        if self._ended[k] and self._autoreset is AutoresetMode.NEXT_STEP:
            self._ended[k] = False
            return Moment(*env.reset())
        observation, reward, terminated, truncated, info = env.step(action)
        moment = Moment(observation, info, float(reward), terminated, truncated)
        self._ended[k] = terminated or truncated
        if self._ended[k] and self._autoreset is AutoresetMode.SAME_STEP:
            moment.final = observation, info
            moment.observation, moment.info = env.reset()
            self._ended[k] = False
        return moment

    def call(self, name: str, arguments: tuple[Any, ...], named: dict[str, Any]) -> list[Any]:
        """Call a method of each, or read an attribute."""
        found = [env.get_wrapper_attr(name) for env in self.envs]
        return [each(*arguments, **named) if callable(each) else each for each in found]

    def render(self) -> list[Any]:
        """Return the image of each."""
        return [env.render() for env in self.envs]

    def close(self) -> None:
        """Close all."""
        for env in self.envs:
            env.close()


class Group(Protocol):
    """Scenes somewhere."""

    def begin_call(self, method: str, *arguments: Any) -> Answer:
        """Begin a call of a method of `Scenes`."""

    def end_scenes(self) -> None:
        """Close the scenes, and end what was started for them."""


class GroupHere:
    """Scenes of this process and thread."""

    def __init__(self, made: Made) -> None:
        self._scenes = Scenes(made)

    def begin_call(self, method: str, *arguments: Any) -> Answer:
        """Call a method when its result is asked for."""
        return lambda: getattr(self._scenes, method)(*arguments)

    def end_scenes(self) -> None:
        """Close the scenes."""
        self._scenes.close()


class GroupElsewhere:
    """Scenes of a process that this one starts, and that ends with it."""

    def __init__(self, made: Made) -> None:
        context = get_context("spawn")
        self._pipe, there = context.Pipe()
        self._process = context.Process(target=_serve, args=(there, made), daemon=True)
        self._process.start()
        there.close()

    def begin_call(self, method: str, *arguments: Any) -> Answer:
        """Begin a call; its answer raises what it raised there, ConnectionError if the process has ended."""
        try:
            self._pipe.send((method, arguments))
        except OSError:
            return self._tell_end
        return self._answer

    def _answer(self) -> Any:
        try:
            result, error = self._pipe.recv()
        except (EOFError, OSError):
            return self._tell_end()
        if error is not None:
            raise error
        return result

    def _tell_end(self) -> None:
        self._process.join(END_S)
        raise ConnectionError(f"a process of scenes has ended, with exit code {self._process.exitcode}")

    def end_scenes(self) -> None:
        """Let the process close its scenes and end; it is terminated if it does not."""
        with suppress(OSError):  # it has ended
            self._pipe.send(None)
        self._process.join(END_S)
        if self._process.is_alive():
            self._process.terminate()
            self._process.join()
        self._pipe.close()


def _serve(pipe: Connection, made: Made) -> None:
    """Answer calls until there are no more; linear algebra has one thread, so that sums have one order everywhere."""
    end_with_parent()
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    scenes: Scenes | None = None
    try:
        while (asked := pipe.recv()) is not None:
            try:
                scenes = scenes or Scenes(made)
                pipe.send((getattr(scenes, asked[0])(*asked[1]), None))
            except Exception as error:
                pipe.send((None, error))
    except (EOFError, OSError, KeyboardInterrupt):
        pass  # whoever asked is gone
    finally:
        if scenes is not None:
            scenes.close()


class GroupOnCluster:
    """Scenes on a worker of a Dask cluster, which has this package and a cache of its own or a shared one."""

    def __init__(self, made: Made, client: Any, worker: str) -> None:
        self._made = client.submit(Scenes, made, actor=True, workers=[worker], pure=False)

    def begin_call(self, method: str, *arguments: Any) -> Answer:
        """Begin a call; the answer raises what it raised there."""
        called = getattr(self._made.result(), method)(*arguments)
        return lambda: called.result()

    def end_scenes(self) -> None:
        """Close the scenes."""
        self.begin_call("close")()
        self._made.release()


def connect(scheduler: str) -> tuple[Any, list[str]]:
    """Return a client of a Dask scheduler, and its workers.

    Raises ConnectionError if no scheduler answers there, or it has no workers.
    """
    client = connect_client(scheduler)
    workers = sorted(client.scheduler_info(n_workers=-1)["workers"])
    if not workers:
        client.close()
        raise ConnectionError(f"the Dask scheduler at {scheduler} has no workers")
    return client, workers
