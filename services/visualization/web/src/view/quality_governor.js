// When a ladder of quality gives up a rung, and when it takes one back: pure, without a clock. The same as
// services/runtime/loop/quality_governor.py, which says why; both are held to test/quality_governor.json. Times in s.
export class QualityGovernor {
  constructor(levels, { calm_s, trial_s, longest_s }, way = [0]) {
    Object.assign(this, { levels, calm_s, trial_s, longest_s: longest_s ?? Infinity });
    this.way = [...way];
    this.wait = calm_s;
    this.calmSince = this.tried = this.cameFrom = null;
  }

  get level() {
    return this.way.at(-1);
  }

  get canLower() {
    return this.level < this.levels - 1;
  }

  // `load`: "over" (the budget is overdrawn), "full" (it is kept without room for a better rung) or "calm" (there is room). Returns
  // whether the level has changed.
  observe(now, load) {
    if (load === "over") {
      this.overdrawn(now);
      return this.canLower && this.descend();
    }
    if (load === "full") {
      this.disturbed(now);
      return false;
    }
    return this.calm(now) && this.comeBack(now);
  }

  disturbed(now) {
    this.calmSince = now;
  }

  isTrying(now) {
    return this.tried !== null && now - this.tried <= Math.max(this.trial_s, this.wait);
  }

  overdrawn(now, leastWait = 0) {
    this.disturbed(now);
    if (this.isTrying(now)) this.wait = Math.min(Math.max(2 * this.wait, leastWait), this.longest_s);
    else this.cameFrom = null;
    this.tried = null;
  }

  descend() {
    this.way.push(this.cameFrom ?? this.level + 1);
    this.cameFrom = null;
    return true;
  }

  calm(now) {
    this.calmSince ??= now;
    if (this.tried !== null && !this.isTrying(now)) {
      this.wait = Math.max(0.5 * this.wait, this.calm_s);
      this.tried = this.cameFrom = null;
    }
    return now - this.calmSince >= this.wait;
  }

  comeBack(now) {
    if (this.way.length === 1) return false;
    this.cameFrom = this.way.pop();
    this.calmSince = this.tried = now;
    return true;
  }
}
