"""How soon a mistake is told: from the tick at which the judge has it to the words in the page.

    python benchmarks/bench_mistakes.py [--rounds 5]

Hands that err 5 % beyond a limit (`tests/training/test_errors.py`), one case for each of E1 to E14, are played in real
time to the judge. As in the training process it looks twelve times a second; as in the page's process what it tells is
taken up with each judgement; the page's server and a browser without a graphics card are true ones. The tick is the
first at which a judge who looks at every tick counts the error, and the words are there when the browser has put them
into the document. Not in it: the way over the bus from physics to the judge, which takes under a millisecond.
"""

from __future__ import annotations

import random
import sys
import tempfile
import time
from pathlib import Path

import msgspec
import numpy as np
from report import Row, parse, write_report

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # the tests' page and their hands

from tests.page.school_page import SchoolPage, school_page
from tests.page.test_school_page import be_in
from tests.training.streams import SCENARIO, SITE, changed, messages
from tests.training.test_errors import CASES, until_s
from trocar.services.supervisor.page.page_server import JUDGEMENT_S
from trocar.services.training.__main__ import RATE_HZ
from trocar.services.training.errors import ERRORS
from trocar.services.training.judge import Judge

BUDGET_MS = 500.0
_LEAD_S = 0.3  # played in real time before the error, so that looks and judgements are under way
_PATIENCE_S = 5.0
_OBSERVE = (
    "globalThis.seenMs = 0; globalThis.watcher?.disconnect();"
    "globalThis.watcher = new MutationObserver(() => (globalThis.seenMs ||= Date.now()));"
    "watcher.observe(document.getElementById('mistakes'), {childList: true});"
    "document.getElementById('mistakes').replaceChildren(); trocar.school.coach.told.clear(); watcher.takeRecords()"
)
Frames = list[tuple[str, int, msgspec.Struct]]


def error_tick_ns(frames: Frames, code: str) -> int:
    """Return the time of the frame with which a judge who looks at every tick first counts an error of `code`."""
    judge = Judge(SCENARIO, SITE)
    for topic, time_ns, body in frames:
        judge.take_frame(topic, time_ns, body)
        if judge.errors.get(code):
            return time_ns
    raise SystemExit(f"the judge finds no {code}")


def play(page: SchoolPage, frames: Frames, at_ns: int, attempt_id: str, code: str, chance: random.Random) -> float:
    """Play the hands in real time; return after how many ms from the tick of the error the words were there."""
    judge, left = Judge(SCENARIO, SITE), iter(frames)
    page.tell(attempt_id=attempt_id, state="running", errors={}, time_s=1.0)
    page.until(f"trocar.school.coach.seen.id === '{attempt_id}'", "the attempt runs")
    page.browser.evaluate(_OBSERVE)
    # Without a phase of its own it kept step with the page, which has just heard.
    began_s = time.time() + 0.05 + chance.uniform(0, JUDGEMENT_S)
    error_s = began_s + _LEAD_S
    look_s, taken_s = began_s + chance.uniform(0, 1 / RATE_HZ), began_s + chance.uniform(0, JUDGEMENT_S)
    pending, told = next(left, None), False
    while time.time() < error_s + _PATIENCE_S and not told:
        time.sleep(max(0.0, min(look_s, taken_s) - time.time()))
        now_s = time.time()
        if now_s >= look_s:
            look_s += 1 / RATE_HZ
            while pending is not None and pending[1] <= at_ns + 1e9 * (now_s - error_s):
                judge.take_frame(*pending)
                pending = next(left, None)
        if now_s >= taken_s:
            taken_s += JUDGEMENT_S
            page.tell(attempt_id=attempt_id, state="running", errors=judge.errors, time_s=2.0)
            told = bool(judge.errors.get(code))
    page.until("globalThis.seenMs > 0", "the mistake is told", _PATIENCE_S)
    return float(page.browser.evaluate("seenMs")) - 1e3 * error_s


def main() -> int:
    """Measure and write the table; return 1 where a mistake is told later than the budget."""
    arguments = parse(__doc__, rounds=(5, "of all fourteen errors"))
    chance = random.Random(7)
    cases = {code: next(key for key in CASES if key[0] == code) for code in ERRORS}
    found: dict[str, list[float]] = {code: [] for code in cases}
    with tempfile.TemporaryDirectory() as folder, school_page(Path(folder)) as page:
        be_in(page)
        browser = page.browser.command("Browser.getVersion")["product"]
        for code, key in cases.items():
            frames = list(messages(changed(CASES[key][0]), until_s(CASES[key][0])))
            at_ns = error_tick_ns(frames, code)
            for k in range(arguments.rounds):
                found[code].append(play(page, frames, at_ns, f"20261201T{k}-{code}", code, chance))
            print(code, [round(ms) for ms in found[code]], flush=True)
    every = np.concatenate([np.array(each) for each in found.values()])
    rows = [
        Row(f"{code}: {cases[code][1]}", float(np.median(ms)), "ms", BUDGET_MS, p99=float(np.percentile(ms, 99)))
        for code, ms in found.items()
    ]
    late = float(np.percentile(every, 99))
    rows += [
        Row("all", float(np.median(every)), "ms", BUDGET_MS, p99=late),
        Row("all, 99 % of them within", late, "ms", BUDGET_MS),
    ]
    notes = (
        f"{arguments.rounds} rounds. The judge looks {RATE_HZ:g} times a second and the page's process takes up what "
        f"is told every {JUDGEMENT_S:g} s, each from a phase drawn anew; {browser} draws on the processor."
    )
    write_report("mistakes", "Mistakes: how soon they are told at the page", rows, notes)
    return 0 if all(row.passed for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
