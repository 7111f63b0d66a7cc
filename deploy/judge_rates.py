"""Judges how often a rig's loops ran: ``python3 deploy/judge_rates.py METRICS SECONDS FLOOR`` (standard library only).

METRICS is the address of the rig's metrics; from there come ticks and age of each loop as it counted them itself. It is
looked at for so many seconds once every loop has followed its needs for a while. FLOOR is a file that
`benchmarks.bare_loop --deadline` wrote: a loop that only wakes a thousand times a second, with the class and the limits
of the rig's loops and at the same time. A loop of the rig is asked for no more than that one had.
"""

from __future__ import annotations

import http.client
import json
import re
import sys
import time
import urllib.request
from collections.abc import Callable
from pathlib import Path

LOOPS = ("gateway", "haptics", "physics")
MEAN_HZ, WORST_HZ = 995.0, 980.0
#: Of each loop's life: it has looked at its needs twenty times by then.
SETTLED_S = 8.0
PATIENCE_S, PAUSE_S = 90.0, 0.2
_ROW = re.compile(
    r'^trocar_(service_uptime_seconds|loop_iterations_total)\{(?:service|loop)="(\w+)"\} (\S+)$', re.MULTILINE
)

Counted = list[tuple[float, float]]
"""Age in seconds and ticks up to then of one loop, again and again."""


def take(text: str, counted: dict[str, Counted]) -> None:
    """Append what the metrics say that is new; of a loop that was started again only what is of its present life."""
    read: dict[str, dict[str, float]] = {}
    for what, name, value in _ROW.findall(text):
        read.setdefault(name, {})[what] = float(value)
    for name in LOOPS:
        row = read.get(name, {})
        if len(row) == 2:
            seen, age_s = counted[name], row["service_uptime_seconds"]
            if seen and age_s < seen[-1][0]:
                seen.clear()
            if not seen or age_s > seen[-1][0]:
                seen.append((age_s, row["loop_iterations_total"]))


def settled(counted: Counted) -> Counted:
    """Return what was counted once the loop had settled."""
    return [each for each in counted if each[0] >= SETTLED_S] if len(counted) > 1 else []


def rates(counted: Counted) -> tuple[float, float]:
    """Return the mean rate, and that of the worst second, Hz."""
    (first_s, first), (last_s, last) = counted[0], counted[-1]
    worst, begin = float("inf"), 0
    for age_s, ticks in counted:
        while age_s - counted[begin][0] >= 1.0:
            worst = min(worst, (ticks - counted[begin][1]) / (age_s - counted[begin][0]))
            begin += 1
    return (last - first) / (last_s - first_s), worst


def faults(counted: dict[str, Counted], floor: dict[str, float]) -> list[str]:
    """Return what is wrong, a sentence for each loop of which something is; say how each ran."""
    found = []
    for name, seen in counted.items():
        mean_hz, worst_hz = rates(settled(seen))
        print(f"  {name}: {mean_hz:.1f} Hz, worst second {worst_hz:.1f}")
        least = min(MEAN_HZ, floor["mean_hz"]), min(WORST_HZ, floor["worst_hz"])
        if mean_hz < least[0] or worst_hz < least[1]:
            found.append(
                f"{name}: {mean_hz:.1f} Hz, worst second {worst_hz:.1f}; asked: {least[0]:.1f}, {least[1]:.1f}"
            )
    return found


def count(read: Callable[[], str], seconds: float) -> dict[str, Counted]:
    """Look until each loop has been seen for so long; exits if that never comes."""
    counted: dict[str, Counted] = {name: [] for name in LOOPS}
    end_s = time.monotonic() + PATIENCE_S + seconds
    while time.monotonic() < end_s:
        take(read(), counted)
        kept = [settled(each) for each in counted.values()]
        if all(each and each[-1][0] - each[0][0] >= seconds for each in kept):
            return counted
        time.sleep(PAUSE_S)
    sys.exit(f"not every loop ran for {seconds:g} s: {[(name, each[-1:]) for name, each in counted.items()]}")


def read_from(address: str) -> str:
    """Return what is at an address, empty where nobody answers: the page is busy, or started again."""
    try:
        with urllib.request.urlopen(address, timeout=10) as answer:
            return str(answer.read().decode())
    except (OSError, http.client.HTTPException):
        return ""


def main(metrics: str, seconds: str, file: str) -> int:
    """Count, judge, and say so."""
    counted = count(lambda: read_from(metrics), float(seconds))
    give_up_s = time.monotonic() + 30.0
    while not (text := Path(file).read_text()).strip() and time.monotonic() < give_up_s:
        time.sleep(PAUSE_S)
    floor = json.loads(text or '{"mean_hz": Infinity, "worst_hz": Infinity}')
    said = f"{floor['mean_hz']:.1f} Hz, worst second {floor['worst_hz']:.1f}" if text else "found no room"
    print(f"  a bare loop beside them: {said}")
    found = faults(counted, floor)
    print(*found, sep="\n", file=sys.stderr)
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
