// Who the rig is, and its state five times a second. A lost link is said and taken up again.

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

export class RigStream {
  // handlers: onRig(rig), onState(state), onLink(text or null)
  constructor(handlers) {
    this.handlers = handlers;
    this.silence = new Silence(performance.now());
    this.open();
    setInterval(() => this.silence.look(performance.now()) && this.lost(), LOOK_MS);
  }

  async open() {
    try {
      const answer = await fetch("api/rig", { cache: "no-store" });
      if (!answer.ok) throw new Error(`status ${answer.status}`);
      const rig = await answer.json();
      this.handlers.onRig(rig);
      this.follow("events");
    } catch {
      this.lost();
      setTimeout(() => this.open(), RETRY_MS);
    }
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
      if (source.readyState !== EventSource.CLOSED) return; // the browser tries again by itself
      source.close();
      setTimeout(() => this.open(), RETRY_MS);
    };
  }

  lost() {
    this.handlers.onLink("No word from the supervisor. The figures below are old; trying again…");
  }
}
