// What a person has picked: which end is what, where the ports are, where the tip is to go. Places are in mm, LPS.

export class Picks {
  constructor(duct) {
    this.ends = duct.ends.map((end) => ({ ...end, newName: end.name }));
    this.mouth = duct.mouth;
    this.held = new Set(duct.held);
    this.ports = duct.ports_mm.map((port) => [...port]);
    this.portsAreOwn = false;
    this.goal = duct.goal_mm;
  }

  kind(name) {
    return name === this.mouth ? "mouth" : this.held.has(name) ? "held" : "free";
  }

  // The old mouth becomes held: an end that nothing holds is the exception.
  setMouth(name) {
    if (name === this.mouth) return;
    this.held.add(this.mouth);
    this.held.delete(name);
    this.mouth = name;
  }

  toggleHeld(name) {
    if (name === this.mouth) return;
    if (!this.held.delete(name)) this.held.add(name);
  }

  setPort(index, place) {
    this.ports[index] = place;
    this.portsAreOwn = true;
  }

  proposePorts() {
    this.portsAreOwn = false;
  }

  // What keeps it from being saved, in a sentence; empty for nothing.
  fault() {
    if (!this.held.size) return "An end must be held: pick one.";
    const names = this.ends.map((end) => end.newName);
    if (names.some((name) => !/^[A-Za-z_]\w*$/.test(name))) return "A name is a plain word: letters, digits and _.";
    if (new Set(names).size < names.length) return "Two ends have the same name.";
    return "";
  }

  body() {
    return {
      mouth: this.mouth,
      held: [...this.held],
      names: Object.fromEntries(this.ends.map((end) => [end.name, end.newName])),
      ports_mm: this.portsAreOwn ? this.ports : [],
      goal_mm: this.goal,
    };
  }
}

// The end whose middle is nearest to a place, null where none is within twice its width.
export function nearestEnd(ends, place) {
  let best = null, least = Infinity;
  for (const end of ends) {
    const away = Math.hypot(...end.at_mm.map((x, k) => x - place[k]));
    if (away < least && away < 2 * end.width_mm) [best, least] = [end, away];
  }
  return best;
}

// The point of the centrelines nearest to a place.
export function onLine(lines, place) {
  let best = null, least = Infinity;
  for (const line of lines)
    for (const point of line) {
      const away = Math.hypot(...point.map((x, k) => x - place[k]));
      if (away < least) [best, least] = [point, away];
    }
  return best;
}
