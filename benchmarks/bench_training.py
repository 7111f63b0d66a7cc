"""What it costs to judge an attempt, to keep ten thousand, and to draw the report of who made a hundred.

    python benchmarks/bench_training.py [--samples 20]

The attempt is made up, of 16 seconds at the recorder's 50 frames of physics a second.
"""

from __future__ import annotations

import tempfile
import time
import zlib
from itertools import chain
from pathlib import Path

import msgspec
from report import Row, measure, parse, write_report
from sqlalchemy import create_engine, insert

from tests.training.simulated import attempt
from tests.training.streams import GOOD, SCENARIO, SITE, messages
from trocar.review.attempts.assess import Terms, assess
from trocar.review.attempts.assessment import Assessment
from trocar.review.attempts.report import render
from trocar.review.attempts.store.attempts import Store
from trocar.review.attempts.store.tables import StoredAttempt, Trainee
from trocar.services.training.score import load_rules

ATTEMPTS, TRAINEES = 10_000, 100
SECONDS = 16.0
RULES = load_rules()


def judged(stream: list[tuple[str, int, msgspec.Struct]]) -> Assessment:
    """Return the assessment of the attempt."""
    (found,) = assess(stream, Terms(scenario_of=lambda _: SCENARIO, rules=RULES, site=SITE), "a.mcap")
    return found


def fill(path: Path, found: Assessment) -> None:
    """Keep ten thousand attempts of a hundred trainees."""
    Store(str(path)).listed()
    data = zlib.compress(msgspec.json.encode(found))
    row = {
        "scenario": found.scenario, "outcome": found.outcome, "counts": True, "time_s": found.time_s, "total": 250.0,
        "percent": None, "errors": 2, "critical": 0, "recording": "/recordings/a.mcap", "assessment": data,
    }  # fmt: skip
    engine = create_engine(f"sqlite:///{path}")
    with engine.begin() as connection:
        connection.execute(insert(Trainee), [{"pseudonym": f"heron-{k}"} for k in range(TRAINEES)])
        connection.execute(
            insert(StoredAttempt),
            [row | {"trainee_id": 1 + k % TRAINEES, "key": str(k), "began_ns": k} for k in range(ATTEMPTS)],
        )
    engine.dispose()


def main() -> None:
    """Measure, and write the table."""
    arguments = parse(__doc__, samples=(20, "calls of each"))
    end = ("training.attempt", 0, attempt("done", outcome="success", time_s=SECONDS))
    stream = list(chain([("training.attempt", 0, attempt())], messages(GOOD, SECONDS), [end]))
    found = judged(stream)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "attempts.sqlite"
        fill(path, found)
        with Store(str(path)) as store:

            def report() -> str:
                past = store.past("heron-7", found.scenario, ATTEMPTS)
                assert len(past) == ATTEMPTS // TRAINEES
                return render(found, RULES, trainee="heron-7", past=past)

            timings = measure(
                {"list": store.listed, "list one": lambda: store.listed("heron-7"), "report": report,
                 "judge": lambda: judged(stream)}, samples=arguments.samples, warmup=2,
            )  # fmt: skip
        began_s = time.perf_counter()
        Store(str(path)).listed("heron-7")
        opened_s = time.perf_counter() - began_s
    rows = [
        Row.from_timing(f"{ATTEMPTS} attempts, listed", timings["list"], limit_s=0.2),
        Row.from_timing("those of one trainee among them, listed", timings["list one"]),
        Row("database opened, and those of one trainee listed", 1e3 * opened_s, "ms"),
        Row.from_timing("report of one who made a hundred, read and drawn", timings["report"], limit_s=2.0),
        Row.from_timing(f"an attempt of {SECONDS:g} s, judged", timings["judge"]),
    ]
    write_report("training", "Attempts: judged, kept and reported", rows)


if __name__ == "__main__":
    main()
