"""A bench of the school: who trains at this rig, in which course; keeps each attempt, and says what is next."""

from __future__ import annotations

import hashlib
import secrets
import threading
import time
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import msgspec

from trocar.review.attempts.assess import Terms
from trocar.review.attempts.assessment import Assessment
from trocar.review.attempts.experts import band_of, counts_of
from trocar.review.attempts.statements import statement
from trocar.review.attempts.store.attempts import Listed, Store
from trocar.review.journal import ActJournal
from trocar.review.school import reports
from trocar.review.school.courses import Course, Made, StepStanding, course_names, load_course, standing, today
from trocar.review.school.listening import wall_minus_monotonic_ns
from trocar.review.school.replays import Replays, folder_of
from trocar.review.school.stills import Stills
from trocar.services.runtime.errors import ConfigError, UserError
from trocar.services.training.scenario import Scenario, asks_for_cholangiogram, load_scenario
from trocar.services.training.score import Band, ScoreRules, load_rules
from trocar.services.training.site import Site

GUEST = "guest"
#: For so long after a look pictures are sent, and a picture is shown, as one look that is late is not to stop them.
_LOOKED_S = 5.0
_BIRDS = ("heron", "finch", "crane", "robin", "swift", "heath", "otter", "lynx", "raven", "plover", "tern", "wren")
_COURSE, _PIN, _EXPERT = "course", "pin", "expert"


class Bench:
    """What the school knows at one rig; every call may come from another thread.

    Args:
        database: Address of the attempts; None for this user's own.
        site: Site of the mouth, for rules that need it.
        journal: File to which each act of an instructor is written, a line of JSON each.
        keeps_guests: Whether attempts are kept while nobody has said who trains.
    """

    def __init__(
        self,
        database: str | None,
        site: Site | None = None,
        journal: Path | None = None,
        *,
        keeps_guests: bool = True,
    ) -> None:
        self._keeps_guests = keeps_guests
        self._database = database
        self._rules: ScoreRules = load_rules()
        self._site = site
        self._lock = threading.Lock()
        self.trainee = ""
        self.last: int | None = None
        self.remark = ""
        self.messages: list[dict[str, Any]] = []
        self._picture, self._picture_s, self._watched_s = b"", -_LOOKED_S, -_LOOKED_S
        self.replays = Replays(folder_of(database))
        self._stills = Stills(self.replays)
        self.journal = ActJournal(journal or folder_of(database).with_suffix(".journal"))

    def pulse(self) -> dict[str, Any]:
        """Return what a page asks for each second: whether somebody looks, the last message, and what has changed."""
        is_watched = time.monotonic() - self._watched_s < _LOOKED_S
        message = self.messages[-1] if self.messages else None
        return {"watched": is_watched, "message": message, "trainee": self.trainee, "last": self.last}

    def show(self, image: bytes) -> None:
        """Take the picture that the page shows."""
        self._picture, self._picture_s = image, time.monotonic()

    def picture(self) -> bytes | None:
        """Return the page's picture if it is young, and ask for the next ones."""
        self._watched_s = time.monotonic()
        return self._picture if self._watched_s - self._picture_s < _LOOKED_S else None

    def terms(self) -> Terms:
        """Return by what attempts are judged here."""
        return Terms(scenario_of=cache(_scenario_of), rules=self._rules, site=self._site)

    def store(self, *, create: bool = True) -> Store:
        """Return the open database. Raises StoreError if it cannot be used."""
        return Store(self._database, create=create, tell=self._say)

    def _say(self, sentence: str) -> None:
        self.remark = sentence

    def take_assessment(self, found: Assessment, recording: Path | None) -> None:
        """Keep an attempt that has ended, under who trains; what is abandoned or cut off is not kept."""
        if found.outcome not in ("success", "failure") or not (self.trainee or self._keeps_guests):
            return
        began_ns = found.began_ns + wall_minus_monotonic_ns(recording)
        source = recording.name if recording is not None else ""
        kept = msgspec.structs.replace(found, began_ns=began_ns, source=source)
        try:
            with self._lock, self.store() as store:
                self.last = store.add(kept, self.trainee or GUEST, recording or Path("none"))
            self.remark = ""
        except UserError as error:
            self.remark = f"the last attempt is not kept: {error}"

    def enter(self, trainee: str, pin: str = "") -> None:
        """Let a trainee begin at this bench. Raises UserError if the name or the PIN is wrong."""
        with self._lock, self.store() as store:
            store.enrol(trainee)
            asked = store.notes(kind=_PIN, trainee=trainee)
            if asked and not secrets.compare_digest(asked[-1].data, _hash(trainee, pin)):
                raise UserError(f"the PIN of {trainee} is another one")
            self.trainee = trainee

    def leave(self) -> None:
        """Let the next attempts be nobody's."""
        self.trainee = ""

    def new_name(self) -> str:
        """Return a pseudonym that nobody has."""
        with self._lock, self.store() as store:
            known = set(store.trainees())
        names = (f"{secrets.choice(_BIRDS)}-{secrets.randbelow(90) + 10}" for _ in range(1000))
        return next((name for name in names if name not in known), f"heron-{secrets.randbelow(10**6)}")

    def choose(self, course: str, by: str = "trainee", trainee: str = "") -> None:
        """Enrol a trainee, by default who is here, in a course. Raises UserError if there is no such course."""
        load_course(course)
        with self._lock, self.store() as store:
            store.note(_COURSE, by, course, trainee=trainee or self.trainee)

    def state(self) -> dict[str, Any]:
        """Return who is here, in which course, what comes next, and all whom one may choose."""
        with self._lock, self.store() as store:
            names = store.trainees()
            told: dict[str, Any] = {
                "trainee": self.trainee, "trainees": names, "courses": _courses(), "last": self.last,
                "remark": self.remark, "messages": self.messages[-20:], "course": None, "next": None,
            }  # fmt: skip
            if self.trainee:
                told |= self._course_of(store, self.trainee)
        return told

    def _course_of(self, store: Store, trainee: str) -> dict[str, Any]:
        chosen = store.notes(kind=_COURSE, trainee=trainee)
        if not chosen:
            return {}
        name = str(chosen[-1].data)
        try:
            course = load_course(name)
        except ConfigError as error:
            return {"remark": str(error)}
        rows = [row for row in store.listed(trainee) if row.began_ns >= chosen[-1].at_ns]
        steps = standing(course, [Made(row, store.assessment(row.id)[0].examined) for row in rows], self._rules)
        done_today = today(rows, time.time_ns())
        rest = course.most_a_day is not None and done_today >= course.most_a_day
        following = next((k for k, step in enumerate(steps) if step.state == "now"), None)
        return {
            "course": {"name": name, "title": course.title, "about": course.about, "steps": steps},
            "next": None if following is None else _step(course, steps, following),
            "done": following is None,
            "rest": f"{done_today} attempts today are enough: come back tomorrow" if rest else "",
        }

    def listed(self, trainee: str) -> list[dict[str, Any]]:
        """Return the attempts of a trainee, the newest first."""
        with self._lock, self.store() as store:
            rows = store.listed(trainee)
            wholes = {row.id: store.assessment(row.id)[0] for row in rows}
        return [
            {
                **msgspec.structs.asdict(row), "recording": "", "title": wholes[row.id].title,
                "attempt_id": wholes[row.id].attempt_id, "has_replay": self.replays.has(wholes[row.id].attempt_id),
                "from_tick": wholes[row.id].from_tick, "examined": wholes[row.id].examined,
            }
            for row in reversed(rows)
        ]  # fmt: skip

    def report(self, number: int) -> dict[str, Any]:
        """Return the report of an attempt. Raises UserError if there is none."""
        with self._lock, self.store() as store:
            found, trainee = store.assessment(number)
            past = store.past(trainee, found.scenario, found.began_ns)
            band, behind = self._band(store, found.scenario)
            said = store.notes(attempt=number)
            has_cholangiogram = asks_for_cholangiogram(found.scenario) and store.recording(number).is_file()
        told = reports.report(found, self._rules, band, past, has_replay=self.replays.has(found.attempt_id))
        return {
            **told, "number": number, "trainee": trainee, "band_of": behind, "notes": said,
            "has_cholangiogram": has_cholangiogram,
        }  # fmt: skip

    def cholangiogram(self, number: int) -> bytes | None:
        """Return the cholangiogram of an attempt's end by `Stills`, None while it is drawn; or raise UserError."""
        with self._lock, self.store() as store:
            found, _ = store.assessment(number)
            recording = store.recording(number)
        if not asks_for_cholangiogram(found.scenario):
            raise UserError(f"the scenario {found.scenario} asks for no cholangiogram")
        return self._stills.still(found, recording)

    def curve(self, trainee: str, scenario: str) -> dict[str, Any]:
        """Return the learning curve of a trainee at a scenario."""
        with self._lock, self.store() as store:
            band, behind = self._band(store, scenario)
            return reports.curve(store.listed(trainee, scenario), self._rules, band, behind)

    def ghost(self, scenario: str) -> str:
        """Return the attempt whose hands are shown as an example: the best success with a replay, experts' first."""
        with self._lock, self.store() as store:
            experts = _experts(store)
            rows = [row for row in store.listed(scenario=scenario) if row.outcome == "success" and row.counts]
            rows.sort(key=lambda row: (row.trainee not in experts, -(row.total or 0.0)))
            for row in rows:
                attempt_id = store.assessment(row.id)[0].attempt_id
                if self.replays.has(attempt_id):
                    return attempt_id
        return ""

    def _band(self, store: Store, scenario: str) -> tuple[Band, int]:
        """Return the band of the reference attempts at a scenario, and how many there are."""
        wholes = [found for who in sorted(_experts(store)) for _, found in store.kept(who)]
        good = [each for each in wholes if each.scenario == scenario and each.outcome == "success" and each.counts]
        return band_of([each.metrics | counts_of(each.errors) for each in good]), len(good)

    def rate(self, number: int, scale: str, points: Mapping[str, int], by: str) -> None:
        """Keep an instructor's rating with an attempt. Raises UserError if it is not one of the scale's."""
        items, most = reports.SCALES.get(scale, ((), 0))
        if not items:
            raise UserError(f"there is no scale {scale!r}; known: {', '.join(reports.SCALES)}")
        wrong = [name for name, value in points.items() if name not in items or not 1 <= value <= most]
        if wrong or not points:
            raise UserError(f"{scale}: {wrong[0] if wrong else 'nothing'} is not rated from 1 to {most}")
        with self._lock, self.store() as store:
            store.note(scale, by, dict(points), attempt=number)
        self._note_act("rate", by, {"attempt": number, "scale": scale, "points": dict(points)})

    def bookmark(self, number: int, at_s: float, words: str, by: str) -> None:
        """Keep a remark on a moment of an attempt."""
        with self._lock, self.store() as store:
            store.note("bookmark", by, {"at_s": at_s, "words": words[:512]}, attempt=number)
        self._note_act("bookmark", by, {"attempt": number, "at_s": at_s, "words": words[:512]})

    def mark(self, trainee: str, kind: str, value: object, by: str) -> None:
        """Say of a trainee whether attempts are references (`expert`), or that a PIN is asked for (`pin`)."""
        if kind not in (_EXPERT, _PIN):
            raise UserError(f"{kind!r} is nothing that is said of a trainee")
        kept = _hash(trainee, str(value)) if kind == _PIN else bool(value)
        with self._lock, self.store() as store:
            store.enrol(trainee)
            store.note(kind, by, kept, trainee=trainee)
        self._note_act(kind, by, {"trainee": trainee, "value": "set" if kind == _PIN else kept})

    def say(self, words: str, by: str) -> None:
        """Show a message at this bench."""
        self.messages.append({"at_ns": time.time_ns(), "by": by, "words": words[:512], "id": secrets.randbits(40)})
        del self.messages[:-20]
        self._note_act("message", by, {"words": words[:512]})

    def table(self) -> list[dict[str, Any]]:
        """Return the class: each trainee with course, attempts, best and last score, and when last seen."""
        found = []
        with self._lock, self.store() as store:
            experts = _experts(store)
            for name in store.trainees():
                rows, told = store.listed(name), self._course_of(store, name)
                found.append(_class_row(name, rows, told, name in experts))
        return found

    def export(self, form: str, trainee: str | None) -> bytes:
        """Return all that is kept of a trainee, or of all: `csv`, `json` or `xapi`."""
        with self._lock, self.store() as store:
            if form == "csv":
                return store.table(trainee).encode()
            if form == "json":
                return store.export(trainee)
            said = [statement(found, who, "https://trocar.example") for who, found in store.kept(trainee)]
        return b"".join(msgspec.json.encode(each) + b"\n" for each in said)

    def erase(self, trainee: str, by: str, *, recordings: bool) -> None:
        """Forget a trainee, who has agreed, with attempts, replays and, if so said, recordings."""
        with self._lock, self.store() as store:
            self.replays.erase([found.attempt_id for _, found in store.kept(trainee)])
            if recordings:
                store.erase_with_recordings(trainee)
            else:
                store.erase(trainee)
        if self.trainee == trainee:
            self.trainee = ""
        self._note_act("erase", by, {"trainee": "erased", "recordings": recordings})

    def _note_act(self, act: str, by: str, data: Mapping[str, object]) -> None:
        """Write an act of an instructor into the journal."""
        self.journal.write({"by": by, "act": act, **data})


def _experts(store: Store) -> set[str]:
    """Return the trainees whose attempts are references."""
    return {note.trainee for note in store.notes(kind=_EXPERT) if note.data}


def _class_row(name: str, rows: list[Listed], told: Mapping[str, Any], is_expert: bool) -> dict[str, Any]:
    counted = [row for row in rows if row.counts]
    totals = [row.total for row in counted if row.total is not None]
    following = told.get("next")
    return {
        "trainee": name, "expert": is_expert, "attempts": len(rows), "counted": len(counted),
        "best": max(totals, default=None), "last": totals[-1] if totals else None,
        "last_ns": rows[-1].began_ns if rows else None, "errors": counted[-1].errors if counted else None,
        "course": told["course"]["title"] if told.get("course") else "",
        "next": following["title"] if following else "finished" if told.get("done") else "",
        "scenarios": sorted({row.scenario for row in rows}),
    }  # fmt: skip


def _courses() -> list[dict[str, Any]]:
    found = []
    for name in course_names():
        try:
            course = load_course(name)
        except ConfigError:
            continue  # an invalid file is an error for those who choose it
        found.append({"name": name, "title": course.title, "about": course.about, "tasks": len(course.steps)})
    return found


def _step(course: Course, steps: list[StepStanding], k: int) -> dict[str, Any]:
    return {**msgspec.structs.asdict(steps[k]), "number": k + 1, "of": len(course.steps)}


def _scenario_of(name: str) -> Scenario:
    from trocar.review.attempts.recorded import PRACTICE

    return load_scenario(name) if name else PRACTICE


def _hash(trainee: str, pin: str) -> str:
    return hashlib.scrypt(pin.encode(), salt=trainee.encode(), n=2**12, r=8, p=1).hex()
