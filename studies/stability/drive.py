"""One run of a simulation under hard hands, watched in every step."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.reduction.reduced_duct import ReducedDuct
from trocar.services.mechanics.reduction.viscoelastic import PronySeries
from trocar.services.mechanics.rod import RodProperties
from trocar.services.mechanics.scene import SceneModel
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.mechanics.simulation.scene_duct import build_scene_duct
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.services.physics.warm_up import warm_up
from trocar.studies.energy_book import EnergyBook
from trocar.studies.stability.criteria import CRITERIA, HAND_SPEED_M_S, REST_S, REST_SPEED_M_S, Figures
from trocar.studies.stability.finely import Explained, FineTicks
from trocar.studies.stability.hands import HandMotions
from trocar.studies.stability.lead import HandLead
from trocar.studies.stability.tick_times import TickTimes
from trocar.studies.stability.watch import Watch, is_at_rest

QUIET_S = 0.1
"""So long in a row at rest ends a run."""
SETTLE_S = 4.0
"""A scene that nobody disturbs has so long to come to rest."""
MOST_SUDDEN = 50
"""Of a run in which forces change at once more often nothing is asked of finer steps: it has failed."""
LEFT_S = 0.1
"""Within so long after the hands have left, what they have bent and stretched is as fast as it gets."""
CLAMPED = 1.8751041
"""Wave number of a clamped beam's first mode, times its length."""
FASTEST_M_S = 1.0
"""What hands leave behind is taken to swing as fast as this at least."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Play:
    """A run: a scene, the hands, and what is to be judged of it.

    Attributes:
        scene: SceneModel
        hands: HandMotions. One row a step; after the last one both tools are gone.
        dt_s: float
        before_step: callable (simulation, step), optional. What else happens, as a switch of the quality level.
        mesh: TriangleMesh, optional. Of the wall, in the place of the scene's.
        rests: bool. Whether it has to come to rest when the hands have left: what is undamped need not.
        has_one_shape: bool. Whether there is one shape of rest, whatever happened: no friction, and nothing that slides
            for free.
        times_ticks: bool. Whether the processor times of its ticks are told: kernels are loaded before then.
        may_jump: bool. Whether the hands or the ticks are other than those of a person: overlaps may be larger then.
    """

    scene: SceneModel
    hands: HandMotions
    dt_s: float = 1e-3
    before_step: Callable[[Simulation, int], None] | None = None
    mesh: TriangleMesh | None = None
    rests: bool = True
    has_one_shape: bool = False
    may_jump: bool = False
    times_ticks: bool = False


@dataclass(frozen=True, slots=True)
class Driven:
    """What came of a run: its figures, a digest of its end, and how many steps it took."""

    figures: Figures
    digest: str
    steps: int


def drive(play: Play) -> Driven:
    """Run a play to its end and return its figures.

    Where a force changes at once, the run is taken again with what finer steps make of that tick.
    """
    driven, sudden = _drive(play, {})
    if not 0 < len(sudden) <= MOST_SUDDEN:
        return driven
    simulation = Simulation(play.scene, reduced_duct(play.scene, play.mesh))
    ticks = FineTicks(simulation, play.hands, play.dt_s, play.before_step)
    forces_n = ticks.forces_n({step for step, _ in sudden})
    driven = _drive(play, {(step, tool): forces_n[step][:, tool] for step, tool in sudden})[0]
    return replace(driven, figures=driven.figures | {"snaps": float(len(sudden))})


def _drive(play: Play, explained: Explained) -> tuple[Driven, list[tuple[int, int]]]:
    duct = reduced_duct(play.scene, play.mesh)
    if play.times_ticks:
        warm_up(play.scene, duct)
    simulation, tools = Simulation(play.scene, duct), ToolInputs()
    speed_m_s = play.hands.top_speed_m_s(play.dt_s)
    play.hands.write(0, tools)
    simulation.step(tools, play.dt_s)
    watch = Watch(simulation, speed_m_s, explained)
    run = _Run(simulation, EnergyBook(simulation), watch, HandLead(simulation), tools, play)
    is_sound = run.through_hands() and run.until_quiet()
    figures = watch.worst | watch.energy_figures()
    figures |= {"healed": float(simulation.healed_states), "dropped": float(sum(simulation.dropped_contacts))}
    figures |= run.times.figures() if play.times_ticks else {}
    is_a_hand = speed_m_s <= HAND_SPEED_M_S and not play.may_jump
    for name in ("penetration", "tool_penetration"):
        depth_m = figures.pop(name)
        if is_a_hand:
            figures[f"{name}_hand"] = depth_m
    if is_a_hand:
        figures |= run.lead.figures()
    if is_sound:
        run.watch.count_crossings()
        figures["crossings"] = run.watch.worst["crossings"]
    if play.rests:
        rest_s = run.rest_s if is_sound else np.inf
        figures |= {"rest": rest_s} if run.longest_s == REST_S else {"rest_damped": rest_s / run.longest_s}
    if is_sound and play.has_one_shape and simulation.inserted_length_m > 0.0:
        figures["shape"] = _distance_m(simulation, play)
    driven = Driven({name: figures[name] for name in CRITERIA if name in figures}, watch.digest(), run.steps)
    return driven, watch.sudden


@dataclass(slots=True)
class _Run:
    simulation: Simulation
    book: EnergyBook
    watch: Watch
    lead: HandLead
    tools: ToolInputs
    play: Play
    times: TickTimes = field(default_factory=TickTimes)
    steps: int = 1
    rest_s: float = np.inf
    longest_s: float = REST_S

    def _let_it_swing(self, fastest_m_s: float) -> None:
        """Allow what swings so fast the time in which its own damping brings it to rest."""
        simulation, speed_m_s = self.simulation, max(fastest_m_s, FASTEST_M_S)
        wall_s = wall_settling_s(simulation.duct.reduced, speed_m_s)
        free_m = self.play.scene.catheter.introducer_to_tip_m
        catheter_s = catheter_settling_s(simulation.catheter.properties, free_m, speed_m_s)
        viscous, length_m = simulation.duct.viscous, self.play.scene.duct.length_m
        creep_s = 0.0 if viscous is None else creep_settling_s(viscous.series, length_m)
        self.longest_s = max(REST_S, wall_s, catheter_s, creep_s)

    def through_hands(self) -> bool:
        return all(self._step() for _ in range(1, len(self.play.hands)))

    def until_quiet(self) -> bool:
        """Go on without hands, until it has been quiet for a while; or not, for as long as it may take."""
        dt_s, quiet_s, gone_s, fastest_m_s = self.play.dt_s, 0.0, 0.0, 0.0
        self._let_it_swing(fastest_m_s)
        while quiet_s < QUIET_S and gone_s < self.longest_s + 2.0 * QUIET_S and self.play.rests:
            if not self._step():
                return False
            gone_s += dt_s
            speed_m_s = self.watch.speed_m_s()
            if gone_s <= LEFT_S and speed_m_s > fastest_m_s:
                fastest_m_s = speed_m_s
                self._let_it_swing(fastest_m_s)
            quiet_s = quiet_s + dt_s if is_at_rest(speed_m_s) else 0.0
        if quiet_s >= QUIET_S:
            self.rest_s = gone_s - quiet_s
        return True

    def _step(self) -> bool:
        play = self.play
        play.hands.write(self.steps, self.tools)
        if play.before_step is not None:
            play.before_step(self.simulation, self.steps)
        self.steps += 1
        try:
            self.book.step(self.tools, play.dt_s)
        except FloatingPointError:
            self.watch.worst["raised"] += 1
            return False
        self.times.enter(self.book.tick_ns)
        self.lead.look(self.tools, play.dt_s)
        return self.watch.look(play.dt_s, self.book.flow)


def wall_settling_s(duct: ReducedDuct, speed_m_s: float = FASTEST_M_S) -> float:
    """In how long the slowest mode of a wall comes to rest by its own damping: it falls as exp(-zeta omega t)."""
    return _settling_s(float(np.min(duct.damping_ratio * duct.basis.omega_rad_s)), speed_m_s)


def creep_settling_s(series: PronySeries, moved_m: float) -> float:
    """In how long a wall that relaxes is at rest again, where hands have held it so far from there for long.

    Freed, it stays where its forces are in balance, and what is left of its way goes as what lags does. Of one term
    that lags by d, K (q - g d) = 0 and tau d' = q - d: so q creeps at g (1 - g) d / tau, and falls as exp(-t (1 - g) /
    tau). Beside others a term falls by the rate (1 - sum g) / tau at least.
    """
    left, longest_s = 1.0 - sum(series.g), 0.0
    for g, tau_s in zip(series.g, series.tau_s, strict=True):
        begun_m_s = g * (1.0 - g) * moved_m / tau_s
        longest_s = max(longest_s, tau_s / left * math.log(max(begun_m_s / REST_SPEED_M_S, 1.0)))
    return longest_s


def catheter_settling_s(rod: RodProperties, free_m: float, speed_m_s: float = FASTEST_M_S) -> float:
    """In how long a catheter comes to rest whose material, and whose supports, damp it nowhere: by its drag alone.

    Drag is proportional to mass along a uniform rod, so each of its vibrations goes as x" + (c / m) x' + w^2 x = 0, c
    and m being the drag and the mass of a particle. It falls as exp(-c t / 2 m) where it swings. A supple one does not
    swing: it creeps back, and the slowest as exp(-r t), r = c / 2 m - sqrt((c / 2 m)^2 - w^2). That is the first mode
    of what is beyond the introducer, ``free_m``: a clamped beam, w^2 = 1.875^4 EI / (rho A L^4). The material's
    damping, and what the catheter rests on, come on top.
    """
    rate_1_s = float(np.min(rod.particle_drag_n_s_m() / rod.particle_mass_kg())) / 2.0
    stiffness_n_m2, density_kg_m = rod.per_end("bending_stiffness_n_m2"), rod.per_segment("linear_density_kg_m")
    slowest_1_s2 = CLAMPED**4 * float(np.min(stiffness_n_m2) / np.max(density_kg_m)) / free_m**4
    if slowest_1_s2 < rate_1_s**2:
        rate_1_s -= math.sqrt(rate_1_s**2 - slowest_1_s2)
    return _settling_s(rate_1_s, speed_m_s)


def _settling_s(rate_1_s: float, speed_m_s: float) -> float:
    """In how long what falls at a rate comes to rest from a speed."""
    return math.log(speed_m_s / REST_SPEED_M_S) / rate_1_s if rate_1_s > 0.0 else math.inf


def _distance_m(simulation: Simulation, play: Play) -> float:
    """How far the catheter ends from where it would have been."""
    undisturbed = _rest_shape(play.scene, play.dt_s)
    return float(np.abs(simulation.catheter.state.position_m - undisturbed).max())


_shapes: dict[tuple[str, float], FloatArray] = {}


def _rest_shape(scene: SceneModel, dt_s: float) -> FloatArray:
    """Where the catheter hangs when nobody has touched it."""
    key = (repr(scene), dt_s)
    if key not in _shapes:
        simulation, tools = Simulation(scene, reduced_duct(scene)), ToolInputs()
        tools.present[:] = False
        for _ in range(round(SETTLE_S / dt_s)):
            simulation.step(tools, dt_s)
        _shapes[key] = simulation.catheter.state.position_m.copy()
    return _shapes[key]


_ducts: dict[str, ReducedDuct] = {}
_MOST_DUCTS = 6


def reduced_duct(scene: SceneModel, mesh: TriangleMesh | None = None) -> ReducedDuct:
    """Return the duct of a scene, the same object for all scenes that have it alike."""
    if mesh is not None:
        return build_scene_duct(scene, cache_directory() / "bases", mesh=mesh)
    key = repr((scene.duct, scene.effects))
    if key not in _ducts:
        if len(_ducts) == _MOST_DUCTS:  # 20 MB each
            del _ducts[next(iter(_ducts))]
        _ducts[key] = build_scene_duct(scene, cache_directory() / "bases")
    return _ducts[key]
