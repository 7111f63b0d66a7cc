"""How many particles the catheter has."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from trocar.services.mechanics.scenarios import insertion_scene
from trocar.services.mechanics.scene import SceneModel
from trocar.studies.accuracy import insertions
from trocar.studies.accuracy.report import costs_us, number, values
from trocar.studies.accuracy.study import Draw, Error, Reference, Row, Setting, Tick

TITLE = "Particles of the catheter"
WHAT = "Segments of the insertion's catheter, 100 mm long. The reference is 200 segments."


def settings(draw: Draw) -> Sequence[Setting]:
    """One series over the number of segments."""
    counts = draw.pick((20, 30), (20, 30, 40, 50, 65, 80), (15, 20, 25, 30, 40, 50, 65, 80, 100, 130))
    return [Setting(f"{n} segments", {"catheter.n_segments": n}) for n in counts]


def reference(draw: Draw) -> Reference:
    """Return the insertion of a catheter of many segments."""
    return insertions.insertion_reference(_scene(draw.pick(60, 200, 200)), draw)


def errors(setting: Setting, reference: Reference, draw: Draw) -> dict[str, Error]:
    """The insertion's."""
    return insertions.insertion_errors(_chosen(setting), reference, draw)


def tick(setting: Setting, draw: Draw) -> Tick:
    """A tick of the insertion."""
    return insertions.insertion_tick(_chosen(setting), draw)


def _chosen(setting: Setting) -> SceneModel:
    return _scene(int(setting.choices["catheter.n_segments"]))


def _scene(n_segments: int) -> SceneModel:
    scene = insertion_scene()
    return replace(scene, catheter=replace(scene.catheter, n_segments=n_segments))


def findings(rows: Sequence[Row]) -> list[str]:
    """Say what a coarser catheter costs in accuracy and saves in time."""
    force, cost = values(rows, insertions.FORCE), costs_us(rows)
    lines = []
    lost = [name for name, error in force.items() if error > 100.0]
    if lost:
        lines.append(f"Too coarse: with {', '.join(lost)} these hands cannot insert the catheter.")
    names = [name for name in force if name not in lost]
    if names and names[0] in cost:
        saved = cost[names[-1]] - cost[names[0]]
        lines.append(
            f"{names[0]} instead of {names[-1]} save {saved:.0f} us of {cost[names[-1]]:.0f} a tick; the error of the "
            f"force is then {number(force[names[0]])} % instead of {number(force[names[-1]])} %."
        )
    return lines
