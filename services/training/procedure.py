"""Phases of the procedure, P0 to P7, as a state machine over situations, with quantities for judging errors."""

from __future__ import annotations

import math

import msgspec

from trocar.protocol.topics import TICK_S
from trocar.services.training.scenario import Phase, Scenario
from trocar.services.training.situation import Hand, Situation

PHASES: dict[Phase, str] = {
    "P0": "traction",
    "P1": "ductotomy (given)",
    "P2": "approach",
    "P3": "align and engage",
    "P4": "advance to the markers",
    "P5": "secure",
    "P6": "flush",
    "P7": "release",
}

# Assumptions, in terms of the catheter, which is 1.7 mm thick (5 Fr), and of the mouth, which is 5 mm wide:
#: The tip is at the mouth: no farther from its middle than its width.
_NEAR_M = 5e-3
#: The catheter is engaged once more of it is inside than its thickness, and is out with less than a third of that.
_ENGAGED_M, _OUT_M = 2e-3, 0.5e-3
#: Squeeze of a clip round duct and catheter: less is mere touch; a clip holds from `clip_min_n`, which is judged apart.
_CLIPPED_N = 0.05
#: A hand that has let go, or a line that was flushed, for less may be at it again: a grasp takes about as long.
_SETTLED_S = 0.5
#: The tip is back at its best depth, within a quarter of the withdrawal that counts as one (`withdrawal_m`).
_BACK_M = 0.5e-3
#: An approach ends no farther before the mouth than about its radius; else nobody has probed it.
_PROBED_M = 3e-3
#: Way of a tip between two situations: more than a hand makes in their 4 to 40 ms, as a scene that begins again does.
_STILL_M = 5e-3


class Span(msgspec.Struct, frozen=True):
    """A phase from `begin_s` to `end_s` of the attempt."""

    phase: Phase
    begin_s: float
    end_s: float


class Procedure:
    """Follows one attempt. All quantities are of simulated time, so a file gives the same results as the live rig.

    Attributes:
        time_s: float. Time since the first situation.
        deepest_m: float. Largest inserted length so far.
        grasps, regrasps, retries, slips, drops: int. Numbers of grasps of the catheter, of those after each hand's
            first, of approaches to the mouth after a withdrawal, of holds that slid through closed jaws, and of
            releases of the catheter before it was engaged.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self.time_s = 0.0
        self.phase: Phase = "P0"
        self.deepest_m = 0.0
        self.grasps = self.regrasps = self.retries = self.slips = self.drops = 0
        self.unheld_s = 0.0
        self.unprimed_s: float | None = None
        self.withdrawal_m: float | None = None
        self.jump_m: float | None = None
        self.slide_m: float | None = None
        self.lost: float | None = None
        self.secured_m: float | None = None
        self.counter_n: float | None = None
        self._spans: list[Span] = []
        self._begun_s = 0.0
        self._first_tick: int | None = None
        self._last: Situation | None = None
        self._step_s = 0.0
        self._engaged_s = math.inf
        self._gripped_s: dict[int, float] = {}
        self._holds: dict[int, tuple[int, tuple[float, float]]] = {}
        self._held_by: set[int] = set()
        self._ever_held: set[int] = set()
        self._primed_s = 0.0
        self._flushed_in_s = 0.0
        self._best_m = self._lowest_m = -math.inf

    @property
    def spans(self) -> list[Span]:
        """The phases so far, the present one last."""
        return [*self._spans, Span(self.phase, self._begun_s, self.time_s)]

    @property
    def order(self) -> tuple[Phase, ...]:
        """Each phase once, in the order of first being reached."""
        return tuple(dict.fromkeys(span.phase for span in self.spans))

    def finish(self) -> None:
        """Process the end of the attempt: an unsecured catheter is judged by its final depth."""
        if self.secured_m is None and self._last is not None and self.phase in ("P4", "P7"):
            self.secured_m = self._last.inserted_m

    def take_situation(self, s: Situation) -> None:
        """Process the next situation."""
        if self._first_tick is None:
            self._first_tick = s.tick
        now_s = (s.tick - self._first_tick) * TICK_S
        self._step_s, self.time_s = now_s - self.time_s, now_s
        self._watch_grips(s)
        self._watch_holds(s)
        self._watch_mouth(s)
        self._watch_flush(s)
        self._watch_counter_traction(s)
        while (following := self._following(s)) != self.phase:
            self._enter(following, s)
        self.deepest_m = max(self.deepest_m, s.inserted_m)
        self._last = s

    def _enter(self, phase: Phase, s: Situation) -> None:
        self._spans.append(Span(self.phase, self._begun_s, self.time_s))
        self.phase, self._begun_s = phase, self.time_s
        if phase == "P4":
            self._engaged_s = min(self._engaged_s, self.time_s)
        if phase == "P5":
            self.secured_m = s.inserted_m

    def _following(self, s: Situation) -> Phase:
        """Return the phase that follows with this situation."""
        phase, held = self.phase, bool(s.catheter_hands)
        if phase == "P0" and (held or any(hand.grips_duct for hand in s.hands)):
            return "P1"
        if phase == "P1":
            return "P2"
        if phase == "P2" and (s.inserted_m > 0.0 or (held and _is_at_mouth(s))):
            return "P3"
        if phase == "P3" and s.inserted_m > _ENGAGED_M:
            return "P4"
        if phase == "P4":
            return "P3" if s.inserted_m < _OUT_M else "P5" if self._is_clipped(s) else "P4"
        if phase in ("P5", "P6"):
            return self._after_securing(s, phase, held)
        return phase

    def _after_securing(self, s: Situation, phase: Phase, held: bool) -> Phase:
        if s.inserted_m < _OUT_M:
            return "P3"
        if phase == "P5":
            if s.flushing:
                return "P6"
            if not (self._gripped_later(s) or s.clipped_n > _CLIPPED_N):
                return "P7" if not held else "P4"
        has_let_go = not held and self.unheld_s > _SETTLED_S
        return "P7" if has_let_go and not s.flushing else phase

    def _is_clipped(self, s: Situation) -> bool:
        """Return whether a clip holds the catheter, or jaws have closed on it at the mouth since it was engaged."""
        return s.clipped_n > _CLIPPED_N or (s.clip_n > _CLIPPED_N and self._gripped_later(s))

    def _gripped_later(self, s: Situation) -> bool:
        return any(hand.grips_duct and self._gripped_s[k] > self._engaged_s for k, hand in enumerate(s.hands))

    def _watch_grips(self, s: Situation) -> None:
        for k, hand in enumerate(s.hands):
            if not hand.grips_duct:
                self._gripped_s.pop(k, None)
            elif k not in self._gripped_s:
                self._gripped_s[k] = self.time_s

    def _watch_holds(self, s: Situation) -> None:
        """Count grasps of the catheter, slips and drops."""
        self.slide_m = self.lost = None
        before, self._held_by = self._held_by, {k for k, hand in enumerate(s.hands) if hand.holds_catheter}
        for k in self._held_by - before:
            self.grasps += 1
            self.regrasps += k in self._ever_held
        for k in before - self._held_by:
            self._watch_loss(k, s.hands[k] if k < len(s.hands) else None)
        self._ever_held |= self._held_by
        for k in self._held_by:
            self._watch_slide(k, s.hands[k])
        was_s = self.unheld_s
        self.unheld_s = self.unheld_s + self._step_s if self._ever_held and not self._held_by else 0.0
        limit_s = self.scenario.limit("dropped_s")
        self.drops += was_s <= limit_s < self.unheld_s and self.phase in ("P2", "P3")

    def _watch_slide(self, k: int, hand: Hand) -> None:
        """Measure the motion of a held point in its jaws since the grasp, or since its last slip."""
        assert hand.hold_m is not None
        known, at = self._holds.get(k, (-1, hand.hold_m))
        if known != hand.hold_id:
            at = hand.hold_m
        slid_m = math.dist(hand.hold_m, at)
        if slid_m > self.scenario.limit("hold_slip_m"):
            self.slide_m, self.slips, at = slid_m, self.slips + 1, hand.hold_m
        self._holds[k] = hand.hold_id, at

    def _watch_loss(self, k: int, hand: Hand | None) -> None:
        """Count a lost hold: one that ends while the handle is not opened beyond the grasp's angle."""
        self._holds.pop(k, None)
        closed_rad = self._last.hands[k].closed_rad if self._last is not None else 0.0
        if hand is not None and hand.jaw_rad <= closed_rad:
            self.slips += 1
            self.lost = 1.0

    def _watch_mouth(self, s: Situation) -> None:
        """Measure withdrawals before a new approach to the mouth, and jumps of the tip out of the lumen."""
        self.withdrawal_m = self.jump_m = None
        last = self._last
        if last is not None and s.inserted_m == 0.0 and math.dist(s.tip_m, last.tip_m) < _STILL_M:
            self.jump_m = last.inserted_m
        depth_m = s.inserted_m or -(s.to_mouth_m or 0.0)
        if self.phase not in ("P3", "P4") or (depth_m < 0.0 and s.to_mouth_m is None):
            return
        if depth_m >= self._best_m - _BACK_M:
            if self._best_m - self._lowest_m > self.scenario.limit("withdrawal_m") and self._best_m > -_PROBED_M:
                self.withdrawal_m = self._best_m - self._lowest_m
                self.retries += 1
            self._best_m = self._lowest_m = max(depth_m, self._best_m) if self.withdrawal_m is None else depth_m
        self._lowest_m = min(self._lowest_m, depth_m)

    def _watch_flush(self, s: Situation) -> None:
        """Check that the line is primed by flushing outside, since flushing inside before that injects air."""
        self.unprimed_s = None
        if s.flushing and s.inserted_m == 0.0:
            self._primed_s += self._step_s
        elif s.flushing and self._primed_s < _SETTLED_S:
            self._flushed_in_s += self._step_s
            self.unprimed_s = self._flushed_in_s

    def _watch_counter_traction(self, s: Situation) -> None:
        """Measure the counter-traction on the duct by the hand that does not hold the catheter, during insertion."""
        self.counter_n = None
        if self.phase in ("P3", "P4") and len(s.hands) > 1 and not self.scenario.view.one_handed and s.catheter_hands:
            others = [hand for hand in s.hands if not hand.holds_catheter]
            if others:
                gripping = [hand.load_n for hand in others if hand.grips_duct]
                self.counter_n = max(*gripping, s.tissue_n[0]) if gripping else 0.0


def _is_at_mouth(s: Situation) -> bool:
    return s.to_mouth_m is None or s.to_mouth_m < _NEAR_M or s.tip_n > 0.0
