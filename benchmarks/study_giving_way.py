"""What a hand feels where a motion gives way: drawn scenes in which most of the time did not happen.

    python benchmarks/study_giving_way.py --results FOLDER/results.jsonl --seed 121203

``--results`` is what ``trocar stability --quick --family drawn --seed 121203 --cases 60 --out FOLDER`` has left. The
ten cases of which most time was withheld are played again, and the forces on both tools are kept in each tick. It
writes benchmarks/results/giving-way.md and docs/results/giving-way.svg.

A tick is one that gave way if any of its time did not happen, and one that came free if it is whole and the tick before
it gave way. Forces fall to zero at once where a contact is lost; such a fall is no kick, and is told apart.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from report import Row, parse, write_report

from trocar.services.mechanics.arrays import BoolArray, FloatArray
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.studies.stability.drive import Play, reduced_duct
from trocar.studies.stability.families import FAMILIES
from trocar.studies.stability.family import Draw, Reach

CASES = 10
FIGURE = Path(__file__).resolve().parents[1] / "docs" / "results" / "giving-way.svg"
#: A tick in which less than this did not happen is whole: what is left are roundings of its parts.
ROUNDING_S = 1e-9
#: Milliseconds that are one point of a curve, the largest force in them; grey is the share of them that gave way.
DRAWN_TICKS = 10


@dataclass(frozen=True, slots=True)
class Felt:
    """Forces on both tools over a play.

    Attributes:
        name: str. The case.
        force_n: (n, 2) float64. Size of the force on each tool in each tick.
        gave_way: (n,) bool. Ticks of which some time did not happen.
        withheld: float. Share of the time that did not happen.
    """

    name: str
    force_n: FloatArray
    gave_way: BoolArray
    withheld: float

    def rise_n(self, ticks: BoolArray) -> float:
        """Return the largest rise of a force from the tick before these ticks (n,) to them."""
        rises = np.diff(self.force_n, axis=0, prepend=self.force_n[:1])[ticks]
        return float(rises.max(initial=0.0))


def play_again(name: str, play: Play) -> Felt:
    """Play a case, as long as there are hands."""
    simulation, tools, dt_s = Simulation(play.scene, reduced_duct(play.scene, play.mesh)), ToolInputs(), play.dt_s
    force_n, withheld_s = np.zeros((len(play.hands), 2)), np.zeros(len(play.hands))
    for tick in range(len(play.hands)):
        play.hands.write(tick, tools)
        before_s = simulation.withheld_s
        simulation.step(tools, dt_s)
        force_n[tick] = np.linalg.norm(simulation.tool_results.force_n, axis=1)
        withheld_s[tick] = simulation.withheld_s - before_s
    return Felt(name, force_n, withheld_s > ROUNDING_S, float(withheld_s.sum() / (dt_s * len(play.hands))))


def worst_cases(path: Path) -> list[str]:
    """Return the names of the cases of which most time was withheld, in a file of results."""
    results = [json.loads(line) for line in path.read_text().splitlines()]
    worst = sorted(results, key=lambda result: -result["figures"]["withheld"])
    return [result["case"] for result in worst[:CASES]]


def row(felt: Felt) -> Row:
    """Return what is told of a case."""
    came_free = ~felt.gave_way & np.roll(felt.gave_way, 1)
    whole = ~felt.gave_way & ~came_free
    rises = {"where it gave way": felt.gave_way, "where it came free": came_free, "where it is whole": whole}
    told = ", ".join(f"{felt.rise_n(ticks):.3f} {name}" for name, ticks in rises.items())
    note = f"{felt.gave_way.sum()} of {len(felt.gave_way)} ticks; largest rise in N: {told}; force up to "
    return Row(felt.name, 100.0 * felt.withheld, "% withheld", note=f"{note}{felt.force_n.max():.2f} N")


def draw(cases: Sequence[Felt], path: Path) -> None:
    """Draw the forces of each case over time, and the share of ticks that gave way, in grey."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 10.0), layout="constrained")
    for axes, felt in zip(figure.subplots(CASES // 2, 2).flat, cases, strict=False):
        n = len(felt.force_n) // DRAWN_TICKS
        force_n = felt.force_n[: n * DRAWN_TICKS].reshape(n, DRAWN_TICKS, 2).max(axis=1)
        gave_way = felt.gave_way[: n * DRAWN_TICKS].reshape(n, DRAWN_TICKS).mean(axis=1)
        time_s, top_n = 1e-3 * DRAWN_TICKS * np.arange(n), 1.05 * float(felt.force_n.max())
        some = gave_way > 0.0
        axes.bar(time_s[some], top_n * gave_way[some], 1e-3 * DRAWN_TICKS, color="0.85", lw=0.0)
        for tool, colour in enumerate(("tab:blue", "tab:orange")):
            axes.plot(time_s, force_n[:, tool], lw=0.7, color=colour, label=f"tool {tool}")
        axes.set(ylim=(0.0, top_n), xlim=(0.0, time_s[-1]), ylabel="N")
        axes.set_title(f"{felt.name}: {100.0 * felt.withheld:.2g} % withheld", fontsize="small")
    figure.axes[0].legend(fontsize="x-small", loc="upper left")
    for axes in figure.axes[-2:]:
        axes.set_xlabel("s")
    with mpl.rc_context({"svg.hashsalt": "trocar", "svg.fonttype": "none"}):
        figure.savefig(path, metadata={"Date": None})


def main() -> None:
    """Play the worst cases again, write the table and draw the curves."""
    arguments = parse(__doc__, results=("results.jsonl", "of the run"), seed=(121203, "of it"))
    drawn = {case.name: case for case in FAMILIES["drawn"].cases(Draw(Reach.QUICK, arguments.seed, 60))}
    felt = []
    for name in worst_cases(Path(arguments.results)):
        if (play := drawn[name].play) is not None:
            felt.append(play_again(name, play()))
            print(name, f"{felt[-1].withheld:.4f}", flush=True)
    write_report("giving-way", __doc__.split(":")[0], [row(each) for each in felt], __doc__.split("\n\n", 2)[2])
    draw(felt, FIGURE)


if __name__ == "__main__":
    main()
