"""Which settings a scene should have on this machine: from the finest down, what frees most time for least error first.

Every step down is tried alone and ranked; then they are taken together, one after the other, and what the whole then
costs and how far it is off is measured, until a tick fits the budget.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from trocar.services.mechanics.effects import EFFECTS
from trocar.services.mechanics.scene import QualityLevel, SceneModel
from trocar.studies.accuracy.insertions import TICK_S
from trocar.studies.accuracy.study import Cost
from trocar.studies.accuracy.trial import HELD_AT, Errors, Run, TrialBench, errors_of
from trocar.studies.progress import Tell

LEAST_ERROR_PERCENT = 0.02
"""Below, errors are rounding, and what frees time for less is free."""
LEAST_FREED = 0.02
"""A rung of the ladder frees at least this share of a tick, and more than the noise: less is not worth a switch."""
_FEWEST_MODES, _FEWEST_SEGMENTS, _COARSEST = 10, 25, (12, 14)
_SWEEPS = (10, 5, 2)
_TICKS_PER_STEP = (1, 2)
_COARSER_IF_MORE = ("duct.mesh_edge_m",)


@dataclass(frozen=True, slots=True)
class Step:
    """One thing that a scene can do with less of."""

    name: str
    changes: Mapping[str, Any] = field(default_factory=dict)
    effect: str = ""

    def apply(self, scene: SceneModel) -> SceneModel:
        """Return the scene with less."""
        if self.effect:
            return replace(scene, effects={n: s for n, s in scene.effects.items() if n != self.effect})
        for key, value in self.changes.items():
            part, _, name = key.partition(".")
            if part == "quality":
                scene = replace(scene, quality=(replace(scene.quality[0], **{name: value}),))
            else:
                scene = replace(scene, **{part: replace(getattr(scene, part), **{name: value})})
        return scene

    def is_less_than(self, scene: SceneModel) -> bool:
        """Return whether it is a step down from where the scene is already, in all that can be counted."""
        for key, value in self.changes.items():
            now = value_of(scene, key)
            if not isinstance(value, str) and not (value > now if key in _COARSER_IF_MORE else value < now):
                return False
        return True


@dataclass(frozen=True, slots=True)
class Rung:
    """A scene with some steps taken, what a tick of it costs, and how far it is off."""

    steps: tuple[Step, ...]
    scene: SceneModel
    cost: Cost
    errors: Errors


@dataclass(frozen=True, slots=True)
class Tuned:
    """What came of it.

    Attributes:
        rungs: list of Rung. From the finest down to the one that fits.
        ladder: tuple of QualityLevel. Of the last rung, what can be switched while it runs: the best first.
        fits: bool. Whether the last rung keeps the budget; else it is the cheapest there is.
    """

    rungs: list[Rung]
    ladder: tuple[QualityLevel, ...]
    fits: bool

    @property
    def scene(self) -> SceneModel:
        """The scene to run, with its ladder."""
        return replace(self.rungs[-1].scene, quality=self.ladder)


def value_of(scene: SceneModel, key: str) -> Any:
    """Return what a scene says under a key of two parts; of the ladder, its best rung."""
    part, _, name = key.partition(".")
    return getattr(scene.quality[0] if part == "quality" else getattr(scene, part), name)


def finest(scene: SceneModel) -> SceneModel:
    """Return the scene with more of everything that only costs time."""
    duct, catheter, best = scene.duct, scene.catheter, scene.quality[0]
    if duct.mesh_file is None:
        duct = replace(duct, n_around=_even(1.4 * duct.n_around), n_along=_even(1.4 * duct.n_along))
    elif duct.mesh_edge_m is not None:
        duct = replace(duct, mesh_edge_m=duct.mesh_edge_m / 1.4)
    duct = replace(duct, n_modes=round(1.5 * duct.n_modes))
    quality = (replace(best, name="full", iterations=2 * best.iterations, without=(), ticks_per_step=1),)
    return replace(
        scene, duct=duct, catheter=replace(catheter, n_segments=round(1.5 * catheter.n_segments)), quality=quality
    )


def steps_down(scene: SceneModel) -> Iterator[Step]:
    """Yield what a scene can do with less of: mesh, modes, particles, sweeps, effects that are not essential.

    Of integrators there is one choice: a catheter by the paper's substeps may go by implicit steps. The other way round
    never pays, for a rod of ours takes hundreds of substeps; and a duct that is touched has one integrator.
    """
    yield from _coarser_meshes(scene)
    for share in (0.6, 0.3, 0.15):
        n_modes = max(round(share * scene.duct.n_modes), _FEWEST_MODES)
        yield Step(f"{n_modes} modes", {"duct.n_modes": n_modes})
    for share in (0.8, 0.65, 0.5):
        n_segments = max(round(share * scene.catheter.n_segments), _FEWEST_SEGMENTS)
        yield Step(f"{n_segments} segments", {"catheter.n_segments": n_segments})
    for sweeps in (round(0.5 * scene.quality[0].iterations), *_SWEEPS):
        yield Step(f"{sweeps} sweeps", {"quality.iterations": sweeps})
    if scene.catheter.integrator != "implicit":
        yield Step("implicit catheter", {"catheter.integrator": "implicit"})
    for name in scene.effects:
        if name not in scene.essential:
            yield Step(f"no {name}", effect=name)


def _coarser_meshes(scene: SceneModel) -> Iterator[Step]:
    duct = scene.duct
    for share in (0.85, 0.7, 0.55):
        if duct.mesh_file is None:
            around, along = (
                max(_even(share * duct.n_around), _COARSEST[0]),
                max(_even(share * duct.n_along), _COARSEST[1]),
            )
            yield Step(f"{around} x {along} cells", {"duct.n_around": around, "duct.n_along": along})
        elif duct.mesh_edge_m is not None:
            edge_m = duct.mesh_edge_m / share
            yield Step(f"edges of {1e3 * edge_m:.2g} mm", {"duct.mesh_edge_m": edge_m})


def tune(scene: SceneModel, budget_us: float, bench: TrialBench, tell: Tell) -> Tuned:
    """Walk down from the finest settings until a tick costs no more than the budget, or to the cheapest there is.

    What seems to free no more time than the noise is given up last, and only where all else is not enough.

    Args:
        scene: SceneModel. Its hands do what it is judged by.
        budget_us: float. For the median of a tick.
        bench: Bench
        tell: callable. Told what is being done, how much of it is done, and of how much.
    """
    best = finest(scene)
    tell("reference", 0, 1)
    reference = bench.run(best, 0.5 * TICK_S)
    surely, perhaps = _ranked(best, bench, reference, tell)
    rungs = _measured(walk_down(best, surely), bench, reference, tell)
    if perhaps and not _fits(rungs, budget_us):
        rungs = _measured(walk_down(best, [*surely, *perhaps]), bench, reference, tell)
    last = next((k for k, rung in enumerate(rungs) if rung.cost.median_us <= budget_us), None)
    rungs = rungs[: (_cheapest(rungs) if last is None else last) + 1]
    return Tuned(rungs, _ladder(rungs[-1].scene, bench, reference, tell), _fits(rungs, budget_us))


def count_runs(scene: SceneModel, *, is_walk: bool) -> float:
    """Return roughly how many runs of the scene's own hands `tune` takes (`is_walk`), or `measure_ladder`.

    What is timed runs most of the way again; the reference takes twice the steps; half of the steps down are walked.
    """
    n_scenes = 1.0
    if is_walk:
        best = finest(scene)
        n_scenes = 1.5 * sum(step.is_less_than(best) for step in steps_down(best))
    return 2.0 + (1.0 + HELD_AT) * (n_scenes + sum(1 for _ in _levels(scene)))


def _fits(rungs: Sequence[Rung], budget_us: float) -> bool:
    return any(rung.cost.median_us <= budget_us for rung in rungs)


def _cheapest(rungs: Sequence[Rung]) -> int:
    return min(range(len(rungs)), key=lambda k: rungs[k].cost.median_us)


def measure_ladder(scene: SceneModel, bench: TrialBench, tell: Tell) -> Tuned:
    """Return the scene as it is, with its quality ladder measured."""
    tell("reference", 0, 1)
    reference = bench.run(finest(scene), 0.5 * TICK_S)
    as_it_is = _measured([((), scene)], bench, reference, tell)
    return Tuned(as_it_is, _ladder(scene, bench, reference, tell), fits=True)


def _ranked(best: SceneModel, bench: TrialBench, reference: Run, tell: Tell) -> tuple[list[Step], list[Step]]:
    """Return the steps that free more time than the noise, and those that seem to free some but no more than that.

    Of each, those first that free most for their error. On a busy machine the noise may be more than what any frees.
    """
    steps = [step for step in steps_down(best) if step.is_less_than(best)]
    alone = _measured([((), best), *(((step,), step.apply(best)) for step in steps)], bench, reference, tell)
    start, surely, perhaps = alone[0], dict[str, float](), dict[str, float]()
    for step, rung in zip(steps, alone[1:], strict=True):
        freed_us = start.cost.median_us - rung.cost.median_us
        if freed_us > 0.0:
            lost = max(rung.errors.worst_percent - start.errors.worst_percent, LEAST_ERROR_PERCENT)
            is_sure = freed_us > max(start.cost.noise_us, rung.cost.noise_us)
            (surely if is_sure else perhaps)[step.name] = freed_us / lost
    return _best_first(steps, surely), _best_first(steps, perhaps)


def _best_first(steps: Sequence[Step], worth: Mapping[str, float]) -> list[Step]:
    return sorted((step for step in steps if step.name in worth), key=lambda step: -worth[step.name])


def walk_down(best: SceneModel, order: Sequence[Step]) -> list[tuple[tuple[Step, ...], SceneModel]]:
    """Return the scenes on the way down; a step back up, to finer than what is already given up, is left out."""
    taken: tuple[Step, ...] = ()
    way = [(taken, best)]
    for step in order:
        if step.is_less_than(way[-1][1]):
            taken = (*taken, step)
            way.append((taken, step.apply(way[-1][1])))
    return way


def _measured(
    scenes: Sequence[tuple[tuple[Step, ...], SceneModel]], bench: TrialBench, reference: Run, tell: Tell
) -> list[Rung]:
    errors = []
    for done, (taken, scene) in enumerate(scenes):
        tell(f"errors, {taken[-1].name if taken else 'finest'}", done, len(scenes))
        errors.append(errors_of(bench.run(scene), reference))
    tell("costs", 0, len(scenes))
    costs = bench.costs([(scene, 0) for _, scene in scenes])
    return [Rung(*each, cost, error) for each, cost, error in zip(scenes, costs, errors, strict=True)]


def _ladder(scene: SceneModel, bench: TrialBench, reference: Run, tell: Tell) -> tuple[QualityLevel, ...]:
    """Return what can be switched while the scene runs, with the measured cost and error of each rung."""
    levels = list(_levels(scene))
    laddered = replace(scene, quality=tuple(levels))
    tell("ladder", 0, len(levels))
    costs = bench.costs([(laddered, k) for k in range(len(levels))])
    told = []
    for k, (level, cost) in enumerate(zip(levels, costs, strict=True)):
        errors = errors_of(bench.run(laddered, level=k), reference)
        told.append(
            replace(
                level,
                cost_us=round(cost.median_us, 1),
                force_error_percent=float(f"{errors.force_percent:.3g}"),
                motion_error_percent=float(f"{errors.motion_percent:.3g}"),
            )
        )
        tell("ladder", k + 1, len(levels))
    return worth_having(told, max(cost.noise_us for cost in costs))


def worth_having(levels: Sequence[QualityLevel], noise_us: float) -> tuple[QualityLevel, ...]:
    """Return the first rung and, dearest first, those below that free enough and that no other beats at both."""
    kept = [levels[0]]
    for level in sorted(levels[1:], key=lambda each: (-_cost_us(each), _error_percent(each))):
        is_beaten = any(
            _cost_us(other) <= _cost_us(level) and _error_percent(other) < _error_percent(level) for other in levels
        )
        freed_us = _cost_us(kept[-1]) - _cost_us(level)
        if not is_beaten and freed_us > max(noise_us, LEAST_FREED * _cost_us(levels[0])):
            kept.append(level)
    return tuple(kept)


def _cost_us(level: QualityLevel) -> float:
    return level.cost_us or 0.0


def _error_percent(level: QualityLevel) -> float:
    return max(level.force_error_percent or 0.0, level.motion_error_percent or 0.0)


def _levels(scene: SceneModel) -> Iterator[QualityLevel]:
    """Yield what may be tried: fewer sweeps; and effects at rest and longer steps together."""
    best = replace(scene.quality[0], name="full", without=(), ticks_per_step=1)
    yield best
    able = tuple(name for name in scene.effects if EFFECTS[name].kind.can_rest and name not in scene.essential)
    resting = [(), *((name,) for name in able), *([able] if len(able) > 1 else [])]
    for sweeps in [sweeps for sweeps in _SWEEPS if sweeps < best.iterations]:
        yield replace(best, name=f"{sweeps} sweeps", iterations=sweeps)
    for ticks, without in itertools.product(_TICKS_PER_STEP, resting):
        if name := _name(ticks, without):
            yield replace(best, name=name, ticks_per_step=ticks, without=without)


def _name(ticks_per_step: int, without: Sequence[str]) -> str:
    longer = f"steps of {ticks_per_step} ms" if ticks_per_step > 1 else ""
    resting = f"without {' and '.join(without)}" if without else ""
    return " ".join(filter(None, (longer, resting)))


def _even(value: float) -> int:
    return 2 * round(0.5 * value)
