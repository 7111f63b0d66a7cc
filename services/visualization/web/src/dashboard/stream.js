// Who the rig is, and its state five times a second. A lost link is said and taken up again.

const RETRY_MS = 1000;
const SILENCE_MS = 3000;

export class RigStream {
  // handlers: onRig(rig), onState(state), onLink(text or null)
  constructor(handlers) {
    this.handlers = handlers;
    this.heard = performance.now();
    this.open();
    setInterval(() => this.watch(), 500);
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
      this.heard = performance.now();
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

  watch() {
    if (performance.now() - this.heard > SILENCE_MS) this.lost();
  }

  lost() {
    this.handlers.onLink("No word from the supervisor. The figures below are old; trying again…");
  }
}
