"""What every effect, and every pair of them, changes, and what it costs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.effects import EFFECTS
from trocar.services.mechanics.scenarios import insertion_scene
from trocar.services.mechanics.scene import SceneModel
from trocar.studies.accuracy import insertions
from trocar.studies.accuracy.effect_pairs import Matrix, draw_matrices, effects_in, matrices, told_pairs
from trocar.studies.accuracy.figures import draw_panels, save_figure
from trocar.studies.accuracy.report import costs_us, number, values
from trocar.studies.accuracy.study import Draw, Error, Reference, Row, Setting, Tick
from trocar.studies.insertion_steps import Inserted, insert, rms

TITLE = "What each effect costs and changes"
WHAT = (
    "The insertion has three effects of its own: gravity, friction and grasp slip. Here one or two effects are added "
    "to it, or taken from it, at their default settings. The numbers are changes, not errors: of the force on the "
    "tools and of the tip's way (root mean square over the insertion), of the depth that the tip reaches, and of the "
    "wall where it has moved furthest. The cost is that of the whole tick; compare it with the first row. In the "
    "figure a cost within the noise is grey, and a pair with a dash is refused, because it models the same thing "
    "twice."
)
DRAWN_ONLY = {"two effects": "Every pair of effects"}
UNCHANGED = "unchanged"
_WIDTH_IN, _ALONE_IN, _PAIRS_IN = 11.0, 6.5, 11.0
_SERIES = UNCHANGED, "one effect", "two effects"
FORCE, TIP, DEPTH, WALL = "change of force", "change of the tip's way", "change of depth", "change of the wall"


def settings(draw: Draw) -> Sequence[Setting]:
    """Unchanged, each effect, and every pair that goes together; on the smallest size of three effects only.

    All are timed in one group, in turns with what they are compared with: 106 simulations are 2.8 GB.
    """
    names = list(EFFECTS)
    names = draw.pick(names[:3], names, names)
    changes: list[tuple[str, ...]] = [(), *((name,) for name in names), *combinations(names, 2)]
    return [_setting(changed) for changed in changes]


def _setting(changed: tuple[str, ...]) -> Setting:
    name, told = ", ".join(_word(each) for each in changed) or UNCHANGED, " ".join(changed)
    return Setting(name, {"changed": told, "effects": _listed(told)}, _SERIES[len(changed)])


def reference(draw: Draw) -> Reference:
    """Return the insertion as it is."""
    run = _run("", draw)
    return {"force_n": run.force_n, "tip_m": run.tip_m, "wall_m": run.wall_m}


def errors(setting: Setting, reference: Reference, draw: Draw) -> dict[str, Error]:
    """Return what has changed."""
    run = _run(str(setting.choices["changed"]), draw)
    wall = np.linalg.norm(run.wall_m - reference["wall_m"], axis=1)
    return {
        FORCE: Error(1e3 * rms(run.force_n - reference["force_n"]), "mN", is_known=False),
        TIP: Error(1e3 * rms(run.tip_m - reference["tip_m"]), "mm", is_known=False),
        DEPTH: Error(1e3 * float(reference["tip_m"][-1, 0] - run.tip_m[-1, 0]), "mm", is_known=False),
        WALL: Error(1e3 * float(wall.max()), "mm", is_known=False),
    }


def tick(setting: Setting, draw: Draw) -> Tick:
    """A tick of the insertion with these effects."""
    return insertions.insertion_tick(_scene(str(setting.choices["changed"])), draw)


def _run(changed: str, draw: Draw) -> Inserted:
    return insert(insertions.TICK_S, cache_directory() / "bases", _scene(changed), insertions.duration_s(draw))


def _scene(changed: str) -> SceneModel:
    """Return the insertion with these effects added where it lacks them, and left out where it has them."""
    scene, wanted = insertion_scene(), changed.split()
    effects = {name: settings for name, settings in scene.effects.items() if name not in wanted}
    effects |= {name: EFFECTS[name].kind.Settings() for name in wanted if name not in scene.effects}
    return replace(scene, effects=effects)


def _listed(changed: str) -> str:
    return ", ".join(_scene(changed).effects)


def _word(name: str) -> str:
    return f"without {name}" if name in insertion_scene().effects else f"with {name}"


def findings(rows: Sequence[Row]) -> list[str]:
    """Say what each effect costs and changes, and which change nothing here."""
    cost, noise = costs_us(rows), {row.setting: row.cost.noise_us for row in rows if row.cost is not None}
    by_quantity = {quantity: values(rows, quantity) for quantity in (FORCE, DEPTH, WALL)}
    singles = dict.fromkeys(row.setting for row in rows if row.series == "one effect")
    lines = []
    for name in singles:
        force, depth, wall = (by_quantity[quantity][name] for quantity in (FORCE, DEPTH, WALL))
        change = f"force {number(force)} mN, depth {number(depth)} mm, wall {number(wall)} mm"
        told = "changes nothing in this scene" if force == depth == wall == 0.0 else change
        if name in cost:
            told += f"; {cost[name] - cost[UNCHANGED]:+.0f} us a tick (noise {noise[name]:.0f})"
        lines.append(f"{name}: {told}.")
    words = [_word(name) for name in effects_in(rows)]
    return [*lines, *(f"Pairs, {told_pairs(each, words, number)}." for each in _matrices(rows))]


def _matrices(rows: Sequence[Row]) -> list[Matrix]:
    return matrices(rows, (FORCE, DEPTH, WALL), signed=(DEPTH,))


def draw_figure(rows: Sequence[Row], stem: Path) -> list[Path]:
    """Draw each effect alone, change over cost, then all pairs as matrices."""
    alone = [row for row in rows if row.series != "two effects"]
    n_panels = len({row.quantity for row in alone})
    figure = Figure((_WIDTH_IN, _ALONE_IN + _PAIRS_IN), layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(TITLE, fontsize=10)
    (above,), (below,) = figure.subfigures(2, 1, height_ratios=(_ALONE_IN, _PAIRS_IN), squeeze=False)
    draw_panels(figure, [above.add_subplot(2, 2, place) for place in range(1, n_panels + 1)], alone)
    draw_matrices(below, _matrices(rows), [_word(name) for name in effects_in(rows)])
    return save_figure(figure, stem)
