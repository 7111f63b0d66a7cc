// The rig's description, and its state five times a second. A lost link is reported and opened again.

const RETRY_MS = 1000;
const LOOK_MS = 500;
const SILENCE_MS = 3000;

// For how long nobody was heard, looked at every `LOOK_MS`. Time in which this page itself was not run counts against nobody: on a
// busy computer a browser stands still for seconds, and what was sent meanwhile is not read yet.
export class Silence {
  constructor(now) {
    this.heard(now);
  }

  heard(now) {
    this.ms = 0;
    this.looked = now;
  }

  // Returns whether it is long enough to be told.
  look(now) {
    this.ms += Math.min(now - this.looked, LOOK_MS);
    this.looked = now;
    return this.ms > SILENCE_MS;
  }
}

// Promises the rig's description; fails where nobody answers.
export async function askRig() {
  const answer = await fetch("api/rig", { cache: "no-store" });
  if (!answer.ok) throw new Error(`status ${answer.status}`);
  return answer.json();
}

export class RigStream {
  // handlers: onRig(rig), onState(state), onLink(text or null); `rig`: as the page was served with it, null where it was not.
  constructor(handlers, rig = null) {
    this.handlers = handlers;
    this.silence = new Silence(performance.now());
    this.begin(rig);
    setInterval(() => this.silence.look(performance.now()) && this.lost(), LOOK_MS);
  }

  // If the page was served with `rig` (else null), it asks for nothing first: on a busy computer an answer takes long.
  begin(rig) {
    if (!rig) return this.open();
    this.follow("events"); // on its way while what is made of the rig is made
    this.handlers.onRig(rig);
  }

  async open() {
    let rig;
    try {
      rig = await askRig();
    } catch {
      this.lost();
      setTimeout(() => this.open(), RETRY_MS);
      return;
    }
    this.begin(rig);
  }

  follow(address) {
    const source = new EventSource(address);
    source.addEventListener("state", ({ data }) => {
      this.silence.heard(performance.now());
      this.handlers.onLink(null);
      this.handlers.onState(JSON.parse(data));
    });
    source.onerror = () => {
      this.lost();
      source.close(); // who answers next may be another rig: it is asked, not only listened to
      setTimeout(() => this.open(), RETRY_MS);
    };
  }

  lost() {
    this.handlers.onLink("No word from the supervisor. The figures below are old; trying again…");
  }
}
