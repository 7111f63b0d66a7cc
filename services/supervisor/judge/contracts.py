"""Judges loops and paths, over a minute and over the last seconds, against the contracts of the rig file."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from trocar.protocol.topics import HEALTH_S
from trocar.services.runtime.config.rig import PATH_OWNERS, Contracts, LoopContract, PathContract
from trocar.services.runtime.measures.histogram import quantile_ns
from trocar.services.supervisor.judge.window import Window

#: A budget is for a minute, and only counts as overdrawn while the last seconds still overdraw it.
BUDGET_S, STILL_S = 60.0, 5.0
#: A loop that spends it within the last seconds, and still does at that rate in the last one, fails as suddenly as in
#: a breakdown.
_SPENT_RATE = BUDGET_S / STILL_S
#: Burn rate of the budget that counts as a breakdown, over a second and still, by the last two reports. At fifty
#: times the allowed rate a minute's budget lasts for 1.2 s.
BREAKDOWN_RATE, _BREAKDOWN_S, _BREAKDOWN_STILL_S = 50.0, 1.0, 2 * HEALTH_S
#: The 99th percentile of fewer samples is nothing else than the longest.
_SAMPLES = 100


@dataclass(frozen=True, slots=True)
class Breach:
    """A violated contract.

    `excess` is the ratio to the limit (1 is just at it). `severe` means beyond the limit from which a restart, then a
    safe stop, is justified; `sudden` that the budget is spent within seconds; `by_work` that it is violated even
    without ticks that were late independently of their work, which a lower quality cannot help.
    """

    process: str
    key: str
    text: str
    excess: float
    severe: bool
    sudden: bool = False
    by_work: bool = True


def judge(windows: Mapping[str, Window], contracts: Contracts) -> list[Breach]:
    """Return the contracts violated by the counts in `windows` (by process).

    The contracts are error budgets with burn rates over a long and a short window (Site Reliability Workbook, chapter
    5). A budget allows for occasional lost ticks; an overdrawn one is reported while it still is overdrawn.
    """
    found = [_judge_loop(name, windows[name], loop) for name, loop in contracts.loops.items() if name in windows]
    found += [_judge_path(name, windows, path, contracts) for name, path in contracts.paths.items()]
    return [breach for breach in found if breach is not None]


def spent_s(
    windows: Mapping[str, Window],
    contracts: Contracts,
    of: Iterable[Breach],
) -> float:
    """Return the largest recent loss by work of loops in breach, in seconds of the loop's budget.

    The losses are those of the last minute, or since the windows were cleared.
    """
    most_s = 0.0
    for name in {breach.process for breach in of} & contracts.loops.keys() & windows.keys():
        contract = contracts.loops[name]
        loss = _loss(windows[name], BUDGET_S, contract)
        if loss is not None and contract.miss_ratio > 0.0:
            most_s = max(most_s, loss.by_work.ratio * loss.seconds / contract.miss_ratio)
    return most_s


@dataclass(frozen=True, slots=True)
class _Loss:
    """Ticks of a loop that were late or never ran, of those due; `beyond_work` are those not caused by its work."""

    lost: float
    due: float
    seconds: float
    beyond_work: float = 0.0

    @property
    def by_work(self) -> _Loss:
        """The loss without those."""
        return _Loss(max(0.0, self.lost - self.beyond_work), self.due, self.seconds)

    @property
    def ratio(self) -> float:
        return self.lost / self.due if self.due > 0 else 0.0


def _loss(window: Window, seconds: float, contract: LoopContract) -> _Loss | None:
    counted = window.loop(seconds)
    if counted is None or counted[1] <= 0:
        return None
    loop, counted_s = counted
    asked_hz = loop.target_hz if contract.follows_readers else contract.rate_hz
    due = min(contract.rate_hz, asked_hz) * counted_s
    # A loop faster than required counts misses of more ticks than are due; a stall that began before the window is
    # counted when it ends.
    share = due / max(loop.target_hz * counted_s, due)
    missed = min(due, loop.misses * share)
    # A count over a window has an uncertainty of one tick. Ticks not reported yet are not attributed to work.
    lost = max(missed, due - loop.ticks - 1.0)
    return _Loss(lost, due, counted_s, loop.beyond_work * share + lost - missed)


def _judge_loop(name: str, window: Window, contract: LoopContract) -> Breach | None:
    spans = (_BREAKDOWN_S, _BREAKDOWN_STILL_S, BUDGET_S, STILL_S)
    losses = [loss for seconds in spans if (loss := _loss(window, seconds, contract)) is not None]
    if len(losses) < len(spans):
        return None
    breach = _breach(name, contract, *losses)
    if breach is None:
        return None
    by_work = _breach(name, contract, *(loss.by_work for loss in losses))
    if by_work is None:
        return replace(breach, by_work=False)
    # What work lost in a minute is not sudden because the host stood still just now. A restart helps against either.
    return replace(by_work, severe=breach.severe)


def _breach(
    name: str, contract: LoopContract, burst: _Loss, still: _Loss, minute: _Loss, lately: _Loss
) -> Breach | None:
    limit = min(BREAKDOWN_RATE * contract.miss_ratio, contract.stop_miss_ratio)
    if min(burst.ratio, still.ratio) > limit:
        text = (
            f"{name}: {100 * burst.ratio:.1f} % of the ticks lost over {burst.seconds:.1f} s, limit {100 * limit:.1f} %"
        )
        severe = min(burst.ratio, still.ratio) > contract.stop_miss_ratio
        return Breach(name, f"{name} ticks", text, _over(burst.ratio, limit), severe, sudden=True)
    budget = contract.miss_ratio * contract.rate_hz * BUDGET_S
    if minute.lost > budget and lately.ratio > contract.miss_ratio:
        text = f"{name}: {minute.lost:.0f} ticks lost in the last minute, budget {budget:.0f}"
        sudden = lately.lost > budget and burst.ratio > _SPENT_RATE * contract.miss_ratio
        return Breach(name, f"{name} ticks", text, _over(minute.lost, budget), severe=False, sudden=sudden)
    return None


def _judge_path(
    name: str, windows: Mapping[str, Window], contract: PathContract, contracts: Contracts
) -> Breach | None:
    stop_us = contract.stop_p99_us
    for process, window in windows.items():
        limit_us = _limit_us(contract, process, window, contracts)
        if _p99_us(window, BUDGET_S, name) > limit_us and (lately_us := _p99_us(window, STILL_S, name)) > limit_us:
            text = f"path {name}: p99 {lately_us:.0f} us over {STILL_S:.0f} s, limit {limit_us:.0f} us"
            severe = stop_us is not None and lately_us > stop_us
            return Breach(PATH_OWNERS[name], f"path {name}", text, _over(lately_us, limit_us), severe)
    return None


def path_limits_us(windows: Mapping[str, Window], contracts: Contracts) -> dict[str, float]:
    """Return the present limit of each path, in us; some depend on the requested picture rate."""
    limits = {name: contract.p99_us for name, contract in contracts.paths.items()}
    for process, window in windows.items():
        counted = [name for name in limits if window.path(name, STILL_S) is not None]
        limits |= {name: _limit_us(contracts.paths[name], process, window, contracts) for name in counted}
    return limits


def _limit_us(contract: PathContract, process: str, window: Window, contracts: Contracts) -> float:
    return contract.p99_us * _stretch(window, contracts.loops.get(process))


def _stretch(window: Window, contract: LoopContract | None) -> float:
    """Return the ratio of a loop's requested period to that of its contract, at least 1.

    A reader that requests 10 pictures a second instead of 30 sees each 1/15 s later by choice.
    """
    counted = window.loop(STILL_S) if contract is not None and contract.follows_readers else None
    if contract is None or counted is None or counted[0].target_hz <= 0:
        return 1.0
    return max(1.0, contract.rate_hz / counted[0].target_hz)


def _p99_us(window: Window, seconds: float, path: str) -> float:
    """Return the 99th percentile, 0 with too few samples."""
    counted = window.path(path, seconds)
    if counted is None or counted.latency.total < _SAMPLES:
        return 0.0
    latency = counted.latency
    return quantile_ns(latency.counts, latency.deadline_ns, 0.99, float(latency.max_ns) or math.inf) / 1e3


def _over(value: float, limit: float) -> float:
    return value / limit if limit > 0 else float("inf")


class Standing:
    """Hysteresis: a breach stands once it was seen for `enter_s`, until it was not seen for `leave_s`."""

    def __init__(self, enter_s: float, leave_s: float) -> None:
        self._enter_s = enter_s
        self._leave_s = leave_s
        self._first_s: dict[str, float] = {}
        self._last: dict[str, tuple[float, Breach]] = {}

    def update(self, now_s: float, seen: list[Breach]) -> list[Breach]:
        """Process the breaches seen at `now_s`; return the standing ones with their newest figures, worst first."""
        for breach in seen:
            self._first_s.setdefault(breach.key, now_s)
            self._last[breach.key] = (now_s, breach)
        for key in [key for key, (at_s, _) in self._last.items() if now_s - at_s >= self._leave_s]:
            del self._last[key], self._first_s[key]
        standing = [b for key, (at_s, b) in self._last.items() if at_s - self._first_s[key] >= self._enter_s]
        return sorted(standing, key=lambda breach: -breach.excess)

    def clear(self) -> None:
        """Clear the state."""
        self._first_s.clear()
        self._last.clear()
