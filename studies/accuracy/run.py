"""A run: references and errors over workers, then the costs one study at a time, all kept as they come."""

from __future__ import annotations

from collections.abc import Sequence

from trocar.studies.accuracy.costs import FLOOR, measure_costs
from trocar.studies.accuracy.log import StudyLog
from trocar.studies.accuracy.study import Cost, Draw, Error, Reference, Row, load_study
from trocar.studies.accuracy.workers import Workers
from trocar.studies.progress import Tell


def compute_reference(study: str, draw: Draw) -> Reference:
    """Return the reference of a study; for workers."""
    return load_study(study).reference(draw)


def compute_errors(study: str, number: int, reference: Reference, draw: Draw) -> dict[str, Error]:
    """Return the errors of one of a study's settings; for workers."""
    module = load_study(study)
    return module.errors(module.settings(draw)[number], reference, draw)


def fill_errors(names: Sequence[str], draw: Draw, log: StudyLog, workers: Workers, tell: Tell) -> None:
    """Compute what the log lacks of references and errors."""
    references = _references(names, draw, log, workers, tell)
    calls, places = [], []
    for name in names:
        for number, setting in enumerate(load_study(name).settings(draw)):
            if (name, setting.name) not in log.errors:
                calls.append((name, number, references[name], draw))
                places.append((name, setting.name))
    tell("errors", 0, len(calls))
    for done, (number, errors) in enumerate(workers.run(compute_errors, calls), 1):
        log.keep_errors(*places[number], errors)
        tell(f"errors, {places[number][0]}", done, len(calls))


def _references(names: Sequence[str], draw: Draw, log: StudyLog, workers: Workers, tell: Tell) -> dict[str, Reference]:
    known = {name: log.reference(name) for name in names}
    missing = [name for name in names if known[name] is None]
    tell("references", 0, len(missing))
    for done, (number, reference) in enumerate(workers.run(compute_reference, [(n, draw) for n in missing]), 1):
        log.keep_reference(missing[number], reference)
        known[missing[number]] = reference
        tell(f"references, {missing[number]}", done, len(missing))
    return {name: reference for name, reference in known.items() if reference is not None}


def fill_costs(names: Sequence[str], draw: Draw, log: StudyLog, tell: Tell) -> None:
    """Measure what the log lacks of costs: here, alone, all settings of a group in turns."""
    every = [(name, group) for name in names for group in _groups(name, draw)]
    missing = [place for place in every if place not in log.timed]
    for done, (name, group) in enumerate(missing):
        tell(f"costs, {name}", done, len(missing))
        log.keep_costs(name, group, group_costs(name, group, draw))
    tell("costs", len(missing), len(missing))


def _groups(name: str, draw: Draw) -> list[str]:
    return list(dict.fromkeys(setting.group for setting in load_study(name).settings(draw)))


def group_costs(name: str, group: str, draw: Draw) -> dict[str, Cost]:
    """Return the costs of the settings of one group of a study."""
    study = load_study(name)
    ticks = {setting.name: study.tick(setting, draw) for setting in study.settings(draw) if setting.group == group}
    timed = {setting: tick for setting, tick in ticks.items() if tick is not None}
    return measure_costs(timed, draw.pick(24, 240, 1200)) if timed else {}


def table(names: Sequence[str], draw: Draw, log: StudyLog) -> list[Row]:
    """Return the rows of all studies, in the order of their settings."""
    rows = []
    for name in names:
        costs = log.costs.get(name, {})
        for setting in load_study(name).settings(draw):
            for quantity, error in log.errors[name, setting.name].items():
                cost = costs.get(setting.name)
                row = Row(
                    study=name,
                    setting=setting.name,
                    series=setting.series,
                    quantity=quantity,
                    error=error.value,
                    unit=error.unit,
                    is_known=error.is_known,
                    cost=cost,
                    choices=setting.choices,
                )
                rows.append(row)
    return rows


def floors(names: Sequence[str], log: StudyLog) -> dict[str, Cost]:
    """Return what the fixed arithmetic cost beside each study."""
    return {name: log.costs[name][FLOOR] for name in names if FLOOR in log.costs.get(name, {})}
