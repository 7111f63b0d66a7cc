"""The suite: all cases of all families, over processes, each judged, kept in a file as they come."""

from __future__ import annotations

import json
import math
import random
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import as_completed
from dataclasses import asdict, dataclass
from pathlib import Path
from time import perf_counter

from trocar.services.files.atomic_file import atomic_file, complete_lines
from trocar.studies.pool import open_pool
from trocar.studies.result_folder import read_as_ours
from trocar.studies.stability.criteria import Figures, failures
from trocar.studies.stability.families import FAMILIES
from trocar.studies.stability.family import Case, Draw, Reach

AGAIN_EVERY = 10
"""One case in so many is run a second time, after another one."""
LAST = ("undamped",)
"""Families whose cases are long: they come when all others have run."""


@dataclass(frozen=True, slots=True)
class Result:
    """What one case showed."""

    family: str
    case: str
    figures: Figures
    steps: int
    seconds: float

    @property
    def failed(self) -> list[str]:
        """The criteria that were not met."""
        return failures(self.figures)


@dataclass(frozen=True, slots=True)
class Order:
    """What to run.

    Attributes:
        reach: Reach
        seed: int
        families: tuple of str
        most: int, optional. Cases of each family, drawn by the seed.
        cases: int, optional. Cases of the family of which each one is drawn afresh.
    """

    reach: Reach
    seed: int
    families: tuple[str, ...]
    most: int | None = None
    cases: int | None = None

    @property
    def draw(self) -> Draw:
        """What families are drawn with."""
        return Draw(self.reach, self.seed, self.cases)


def list_cases(order: Order) -> list[tuple[str, str]]:
    """Return family and name of every case, in the order of the table."""
    return [(family, name) for family in order.families for name in _names(order, family)]


def _names(order: Order, family: str) -> list[str]:
    names = [case.name for case in FAMILIES[family].cases(order.draw)]
    if order.most is None or len(names) <= order.most:
        return names
    drawn = set(random.Random(f"{order.seed} {family}").sample(names, order.most))
    return [name for name in names if name in drawn]


def run_case(order: Order, family: str, name: str) -> Result:
    """Run one case of a family, and once more after another of it where it is its turn."""
    case = find_case(order, family, name)
    start = perf_counter()
    driven = case.run()
    figures = dict(driven.figures)
    for unsound in ("healed", "dropped"):
        if FAMILIES[family].may_heal and unsound in figures:
            figures[f"{unsound}_by_design"] = figures.pop(unsound)
    other = _other_case(order, family, name)
    if other is not case and zlib.crc32(f"{family} {name}".encode()) % AGAIN_EVERY == 0:
        other.run()
        figures["leaks"] = float(case.run().digest != driven.digest)
    return Result(family, name, figures, driven.steps, perf_counter() - start)


def run_cases(order: Order, cases: Iterable[tuple[str, str]], jobs: int) -> Iterator[Result]:
    """Run cases over processes and yield each result as it comes."""
    if jobs == 1:
        yield from (run_case(order, *case) for case in cases)
        return
    with open_pool(jobs) as pool:
        for done in as_completed([pool.submit(run_case, order, *case) for case in cases]):
            yield done.result()


class Log:
    """Results in a folder, one line of JSON each: what is there is not run again.

    Raises ValueError if the folder holds results of another order, or of other code.
    """

    def __init__(self, folder: Path, order: Order, code: str) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        head = {"reach": order.reach.value, "seed": order.seed, "most": order.most, "cases": order.cases, "code": code}
        head_file, self._file = folder / "order.json", folder / "results.jsonl"
        with read_as_ours(folder):
            if head_file.exists() and json.loads(head_file.read_text()) != head:
                raise ValueError(f"{folder} holds the results of {json.loads(head_file.read_text())}, not of {head}")
            self.results = [Result(**json.loads(line)) for line in complete_lines(self._file)]
        with atomic_file(head_file) as half:
            half.write_text(json.dumps(head))

    def keep(self, result: Result) -> None:
        """Write a result down."""
        self.results.append(result)
        with self._file.open("a") as file:
            file.write(json.dumps(asdict(result)) + "\n")


def run_suite(
    order: Order, jobs: int, log: Log, tell: Callable[[Result, int, int], None], longest_s: float = math.inf
) -> list[Result]:
    """Run what the log lacks, tell of each as it comes, and return all results in the order of the table.

    After ``longest_s`` no case is begun.
    """
    start = perf_counter()
    every = list_cases(order)
    known = {(result.family, result.case) for result in log.results}
    wanted = by_turns([case for case in every if case not in known], order.seed)
    for count, result in enumerate(run_cases(order, wanted, jobs), len(every) - len(wanted) + 1):
        log.keep(result)
        tell(result, count, len(every))
        if perf_counter() - start > longest_s:
            break
    place = {case: k for k, case in enumerate(every)}
    mine = [result for result in log.results if (result.family, result.case) in place]
    return sorted(mine, key=lambda result: place[result.family, result.case])


def by_turns(cases: Sequence[tuple[str, str]], seed: int) -> list[tuple[str, str]]:
    """Shuffle each family's cases, and take one of each by turns: what is there after a while speaks for all."""
    shuffled, taken, turn = list(cases), Counter[str](), {}
    random.Random(seed).shuffle(shuffled)
    for case in shuffled:
        turn[case] = (case[0] in LAST, taken[case[0]])
        taken[case[0]] += 1
    return sorted(shuffled, key=turn.__getitem__)


_cases: dict[tuple[Order, str], dict[str, Case]] = {}


def find_case(order: Order, family: str, name: str) -> Case:
    """Return a case by its name. Raises ValueError: two cases of the family have the same one."""
    if (order, family) not in _cases:
        listed = list(FAMILIES[family].cases(order.draw))
        _cases[order, family] = {case.name: case for case in listed}
        if len(_cases[order, family]) < len(listed):
            raise ValueError(f"family '{family}' gives two of its cases the same name")
    return _cases[order, family][name]


def _other_case(order: Order, family: str, name: str) -> Case:
    """The next case of the family, as a disturber; the same one if it is alone."""
    names = list(_cases[order, family])
    return _cases[order, family][names[(names.index(name) + 1) % len(names)]]
