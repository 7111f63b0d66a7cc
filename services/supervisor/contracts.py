"""Judging: what loops and paths did over the window against what the rig file says they must keep."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from services.runtime.rig import Contracts, LoopContract, PathContract
from services.supervisor.figures import Figures, Loop

#: Whose work decides a path: the process to act on when it is too slow.
PATH_OWNERS = {
    "servo": "gateway",
    "device_model": "haptics",
    "device_force": "haptics",
    "device_pixel": "visualization",
}
#: With fewer samples there is no 99th percentile to speak of.
_SAMPLES = 100


@dataclass(frozen=True, slots=True)
class Breach:
    """A contract that is not kept.

    `excess` is how many times over the limit (1 is just at it); `severe` says that it is past the limit from which a
    restart, then a safe stop, is worth its price.
    """

    process: str
    key: str
    text: str
    excess: float
    severe: bool


def judge(figures: Mapping[str, Figures], contracts: Contracts) -> list[Breach]:
    """Return the contracts that the windows in `figures` (by process) break."""
    breaches: list[Breach] = []
    for name, contract in contracts.loops.items():
        window = figures.get(name)
        if window is not None and window.loop is not None and window.seconds > 0:
            breaches += _judge_loop(name, window.loop, window.seconds, contract)
    for name, path_contract in contracts.paths.items():
        breach = _judge_path(name, figures, path_contract)
        if breach is not None:
            breaches.append(breach)
    return breaches


def _judge_loop(name: str, loop: Loop, seconds: float, contract: LoopContract) -> list[Breach]:
    breaches = []
    if loop.miss_ratio > contract.miss_ratio:
        text = (
            f"{name}: {100 * loop.miss_ratio:.2f} % of the ticks missed over {seconds:.1f} s, "
            f"limit {100 * contract.miss_ratio:.2f} %"
        )
        excess = _over(loop.miss_ratio, contract.miss_ratio)
        severe = loop.miss_ratio > contract.stop_miss_ratio
        breaches.append(Breach(name, f"{name} misses", text, excess, severe))
    # One tick is what a count over a window can be off by.
    least = contract.rate_hz * (1.0 - contract.miss_ratio)
    if (loop.ticks + 1) / seconds < least:
        rate = loop.ticks / seconds
        text = f"{name}: {rate:.1f} Hz over {seconds:.1f} s, limit {least:.1f} Hz"
        severe = rate < contract.rate_hz * (1.0 - contract.stop_miss_ratio)
        breaches.append(Breach(name, f"{name} rate", text, _over(least, rate), severe))
    return breaches


def _judge_path(name: str, figures: Mapping[str, Figures], contract: PathContract) -> Breach | None:
    limit_us, stop_us = contract.p99_us, contract.stop_p99_us
    for process, window in figures.items():
        path = window.paths.get(name)
        if path is None or path.latency.total < _SAMPLES:
            continue
        p99 = path.latency.quantiles().p99
        if p99 > limit_us:
            text = f"path {name}: p99 {p99:.0f} us over {window.seconds:.1f} s, limit {limit_us:.0f} us"
            severe = stop_us is not None and p99 > stop_us
            return Breach(PATH_OWNERS.get(name, process), f"path {name}", text, _over(p99, limit_us), severe)
    return None


def _over(value: float, limit: float) -> float:
    return value / limit if limit > 0 else float("inf")


class Standing:
    """Hysteresis: a breach stands once it was seen for `enter_s`, and until it was not seen for `leave_s`."""

    def __init__(self, enter_s: float, leave_s: float) -> None:
        self._enter_s = enter_s
        self._leave_s = leave_s
        self._first_s: dict[str, float] = {}
        self._last: dict[str, tuple[float, Breach]] = {}

    def update(self, now_s: float, seen: list[Breach]) -> list[Breach]:
        """Take what was seen at `now_s`; return the breaches that stand, newest figures, worst first."""
        for breach in seen:
            self._first_s.setdefault(breach.key, now_s)
            self._last[breach.key] = (now_s, breach)
        for key in [key for key, (at_s, _) in self._last.items() if now_s - at_s >= self._leave_s]:
            del self._last[key], self._first_s[key]
        standing = [b for key, (at_s, b) in self._last.items() if at_s - self._first_s[key] >= self._enter_s]
        return sorted(standing, key=lambda breach: -breach.excess)

    def clear(self) -> None:
        """Forget everything: what follows is judged anew."""
        self._first_s.clear()
        self._last.clear()
