"""The native window beside the rig, drawn by the processor on a virtual display: when it opens, what it costs.

    python benchmarks/bench_window.py [--pairs 6] [--seconds 30] [trocar up's options]

The stub rig without any picture, then with ``--viewer native`` on Xvfb (Debian's xvfb), on the cores that the rig runs
on; the next pair the other way round, and so on. What the window costs the loops is the mean over the pairs of their
misses with it less those without, and whether that is more than noise is judged by how the pairs differ (95 %, by
Student's t). A window is open when its process says that it is ready; pictures are those that it has drawn, at the
size that xdotool finds it to have at the end.
"""

from __future__ import annotations

import argparse
import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
from report import Row, noise, write_report
from watched_rig import WatchedRig, print_alarms

from tests.virtual_display import VirtualDisplay

SETTLE_S = 5.0
FAST = ("gateway", "haptics", "physics")
_PICTURES = 'trocar_gauge{name="window_pictures",service="visualization"}'


@contextmanager
def virtual_display() -> Iterator[str]:
    """Yield the name of a display that nobody sees."""
    display = VirtualDisplay()
    try:
        yield display.name
    finally:
        display.end()


def without(seconds: float, options: list[str]) -> list[Row]:
    """Return the table of a rig without picture."""
    with WatchedRig(options, viewer="none") as rig:
        rig.settle(SETTLE_S)
        rig.watch(seconds)
        print_alarms(rig, "no window")
        return rig.rows("no window")


def with_window(seconds: float, options: list[str]) -> list[Row]:
    """Return the table of a rig with a window."""
    with virtual_display() as display, WatchedRig(options, "native", {"DISPLAY": display}) as rig:
        opened_s = rig.ready_s("visualization")
        rig.settle(SETTLE_S)
        rig.watch(seconds)
        print_alarms(rig, "window")
        samples = rig.history.samples
        painted = np.diff([sample.counts.get(_PICTURES, 0.0) for sample in samples])
        a_second = painted / np.diff([sample.t for sample in samples])
        return [
            *rig.rows("window"),
            Row("window: open after the start of the rig", opened_s, "s", 10.0),
            Row("window: pictures a second", float(painted.sum()) / rig.seconds, "1/s", 12.0, at_least=True),
            Row("window: its height at the end", _height(display), "px", 720.0, at_least=True),
            Row("window: pictures a second, 5 % of the seconds below", float(np.percentile(a_second, 5)), "1/s"),
        ]


def _height(display: str) -> float:
    """Return how many lines the window has: one that cannot follow gives up pixels."""
    command = ["xdotool", "search", "--name", "Trocar", "getwindowgeometry", "--shell"]
    said = subprocess.run(command, env={**os.environ, "DISPLAY": display}, check=True, capture_output=True, text=True)
    return float(dict(line.split("=") for line in said.stdout.split())["HEIGHT"])


def together(runs: list[list[Row]]) -> list[Row]:
    """Return the medians of the same rows of several runs, and the range beside each; alarms are added up."""
    rows = []
    for row, *others in zip(*runs, strict=True):
        values = [row.value, *(other.value for other in others)]
        if row.unit:
            rows.append(replace(row, value=float(np.median(values)), note=f"{min(values):.3g} to {max(values):.3g}"))
        else:
            rows.append(replace(row, value=sum(values)))
    return rows


def harm(alone: list[list[Row]], drawn: list[list[Row]]) -> list[Row]:
    """Return what the window adds to the misses of each loop, beside what the pairs differ by."""
    rows = []
    for loop in FAST:
        name = f"{loop}: late or lost ticks"
        pairs = [(_value(one, f"window: {name}"), _value(two, f"no window: {name}")) for one, two in
                 zip(drawn, alone, strict=True)]  # fmt: skip
        differences = np.array([one - two for one, two in pairs])
        name = f"{loop}: misses that the window adds, less than noise"
        rows.append(Row(name, float(differences.mean()), "%", noise(differences)))
    return rows


def _value(rows: list[Row], name: str) -> float:
    return next(row.value for row in rows if row.name == name)


def main() -> None:
    """Measure and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, default=6)
    parser.add_argument("--seconds", type=float, default=30.0, help="that each rig is watched")
    arguments, options = parser.parse_known_args()
    alone: list[list[Row]] = []
    drawn: list[list[Row]] = []
    for pair in range(arguments.pairs):
        for is_drawn in (False, True) if pair % 2 == 0 else (True, False):
            if is_drawn:
                drawn.append(with_window(arguments.seconds, options))
            else:
                alone.append(without(arguments.seconds, options))
    notes = (
        f"{arguments.pairs} pairs of rigs, each watched for {arguments.seconds:g} s: without a picture, and with the "
        "native window on Xvfb (software rendering) on the rig's own cores. Values are medians with their range. What "
        "the window adds is a mean, and its budget what 95 % of such means would be by chance. An alarm is false where "
        "no histogram shows what it says. The answers are those of the dashboard."
    )
    rows = [*together(alone), *together(drawn), *harm(alone, drawn)]
    write_report("window", "The native window beside the rig", rows, notes)


if __name__ == "__main__":
    main()
