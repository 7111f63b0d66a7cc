"""The native window beside the rig, drawn by the processor on a virtual display: when it opens, what it costs.

    python benchmarks/bench_window.py [--minutes 3] [trocar up's options]

The stub rig without any picture, then the same with ``--viewer native`` on Xvfb (Debian's xvfb), on the cores that the
rig runs on. A window is open when its process says that it is ready; pictures are those that it has drawn.
"""

from __future__ import annotations

import argparse
import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from report import Row, write_report
from watched_rig import WatchedRig, print_alarms

SETTLE_S, ALONE_S = 10.0, 60.0
_PICTURES = 'trocar_gauge{name="window_pictures",service="visualization"}'


@contextmanager
def virtual_display() -> Iterator[str]:
    """Yield the name of a display that nobody sees."""
    read, write = os.pipe()
    command = ["Xvfb", "-displayfd", str(write), "-screen", "0", "1300x820x24", "-nolisten", "tcp"]
    server = subprocess.Popen(command, pass_fds=[write], stderr=subprocess.DEVNULL)
    os.close(write)
    try:
        with os.fdopen(read) as ready:
            yield f":{ready.readline().strip()}"
    finally:
        server.terminate()
        server.wait()


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
            Row("window: pictures a second", float(painted.sum()) / rig.seconds, "1/s", 10.0, at_least=True),
            Row("window: pictures a second, 5 % of the seconds below", float(np.percentile(a_second, 5)), "1/s"),
        ]


def main() -> None:
    """Measure and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=3.0)
    arguments, options = parser.parse_known_args()
    seconds = 60.0 * arguments.minutes
    rows = without(min(ALONE_S, seconds), options) + with_window(seconds, options)
    notes = (
        f"{arguments.minutes:g} minutes with the native window on Xvfb (software rendering) on the rig's own cores, "
        f"after {min(ALONE_S, seconds):g} s of another rig without a picture. An alarm is false where no histogram "
        "shows what it says. The answers are those of the dashboard."
    )
    write_report("window", "The native window beside the rig", rows, notes)


if __name__ == "__main__":
    main()
