"""What a class page costs each of its rigs: ``python benchmarks/bench_classroom.py [--turns 6] [--seconds 30]``.

One stub rig, followed once a second as `trocar classroom` follows it, and not, in turns: what its page's process takes
of a core, how many ticks are late, and what a scrape of the summary costs beside it. The class page itself runs
here too, with nine more rigs that are page servers without a rig behind them, as its own cost is the instructor's.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from contextlib import closing
from pathlib import Path
from statistics import median

import httpx
import numpy as np
from report import Row, noise, write_report
from watched_rig import WatchedRig

from tests.review.class_of_pages import rigs, until, write_roll
from trocar.review.classroom.app import Classroom
from trocar.services.mechanics.arrays import FloatArray

LOOPS = ("gateway", "haptics", "physics")
SETTLE_S = 10.0
WAYS = ("not followed", "followed", "scraped")


class Counts:
    """Sums of what the rig exports, by the way in which it was looked at."""

    def __init__(self, address: str, rig: int) -> None:
        self._address = address
        children = Path(f"/proc/{rig}/task/{rig}/children").read_text().split()
        names = {pid: Path(f"/proc/{pid}/cmdline").read_bytes() for pid in children}
        self._page = next(pid for pid, name in names.items() if b"page_server" in name)
        self.seconds = dict.fromkeys(WAYS, 0.0)
        self.shares: dict[str, list[float]] = {way: [] for way in WAYS}
        self.lost: dict[tuple[str, str], list[float]] = {(way, loop): [] for way in WAYS for loop in LOOPS}
        self.due: dict[tuple[str, str], list[float]] = {key: [] for key in self.lost}

    def read(self) -> dict[str, float]:
        text = httpx.get(f"{self._address}metrics", timeout=30.0).text
        return {
            key: float(value)
            for key, _, value in (line.rpartition(" ") for line in text.splitlines() if line[0] != "#")
        }

    def page_s(self) -> float:
        """Return the processor time of the page's process: what it has started is not asked by a class."""
        tasks = Path(f"/proc/{self._page}/task").glob("*/schedstat")
        return sum(int(task.read_text().split()[0]) for task in tasks) * 1e-9

    def turn(self, way: str, seconds: float) -> None:
        """Wait for so long and count what happened meanwhile."""
        began, before, used_s = time.monotonic(), self.read(), self.page_s()
        if way == "scraped":
            end_s = began + seconds
            while time.monotonic() < end_s:
                time.sleep(1.0)
                self.read()
        else:
            time.sleep(seconds)
        used_s = self.page_s() - used_s
        after, took_s = self.read(), time.monotonic() - began
        self.seconds[way] += took_s
        self.shares[way].append(used_s / took_s)
        for loop in LOOPS:
            rose = [
                after[name] - before[name]
                for name in (
                    f'trocar_deadline_misses_total{{loop="{loop}"}}',
                    f'trocar_loop_iterations_total{{loop="{loop}"}}',
                    f'trocar_loop_skipped_total{{loop="{loop}"}}',
                )
            ]
            self.lost[way, loop].append(rose[0])
            self.due[way, loop].append(rose[1] + rose[2])

    def share(self, way: str, loop: str) -> FloatArray:
        """Return the ticks late or lost of each turn, in percent."""
        return 100.0 * np.array(self.lost[way, loop]) / np.array(self.due[way, loop])


def in_turns(rig: WatchedRig, turns: int, seconds: float) -> tuple[Counts, float]:
    """Look at the rig in each way, turn by turn; return the counts and what the class page took of a core."""
    counts, class_s, followed_s = Counts(rig.address, rig.process.pid), 0.0, 0.0
    with rigs(9) as (_, others), tempfile.TemporaryDirectory() as folder:
        roll = write_roll(Path(folder) / "class.toml", [rig.address.rstrip("/"), *others])
        for turn in range(turns):
            for way in WAYS if turn % 2 else WAYS[::-1]:
                if way != "followed":
                    counts.turn(way, seconds)
                    continue
                began_s = time.process_time()
                with closing(Classroom(roll)) as classroom:
                    until(lambda: classroom.watch("bench-0").row().state != "silent", "followed")
                    counts.turn(way, seconds)
                class_s, followed_s = class_s + time.process_time() - began_s, followed_s + seconds
    return counts, class_s / followed_s


def rows(counts: Counts, class_share: float) -> list[Row]:
    """Return the table."""
    still = median(counts.shares["not followed"])
    found = []
    for way in WAYS:
        found.append(Row(f"{way}: the page's process, share of a core, median", 100 * median(counts.shares[way]), "%"))
        for loop in LOOPS:
            lost, due = sum(counts.lost[way, loop]), sum(counts.due[way, loop])
            found.append(Row(f"{way}: {loop}: ticks late or lost, of {due:.0f}", lost, ""))
    paired = [b - a for a, b in zip(counts.shares["not followed"], counts.shares["followed"], strict=True)]
    found.append(Row("followed: more of a core than not, median of turns", 100 * median(paired), "%", 0.5))
    for loop in LOOPS:
        more = counts.share("followed", loop) - counts.share("not followed", loop)
        name = f"{loop}: late or lost ticks that being followed adds, less than noise"
        found.append(Row(name, float(more.mean()), "%", noise(more)))
    scraped = 100 * (median(counts.shares["scraped"]) - still)
    found.append(Row("scraped once a second (summary): more of a core than not", scraped, "%"))
    found.append(Row("class page of ten rigs, with nine of them served by the same process", 100 * class_share, "%"))
    return found


def main() -> None:
    """Measure and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--turns", type=int, default=6)
    parser.add_argument("--seconds", type=float, default=30.0)
    arguments, options = parser.parse_known_args()
    with WatchedRig(options) as rig:
        rig.settle(SETTLE_S)
        counts, class_share = in_turns(rig, arguments.turns, arguments.seconds)
    notes = (
        f"The stub rig; {arguments.turns} turns of {arguments.seconds:g} s each way, on a machine that others use too. "
        "A share is of processor time as the kernel counts it, so that other load does not enter but by cold caches. "
        "What being followed adds is a mean over the turns, and its budget what 95 % of such means would be by chance."
    )
    write_report("classroom", "A rig that a class follows", rows(counts, class_share), notes)


if __name__ == "__main__":
    main()
