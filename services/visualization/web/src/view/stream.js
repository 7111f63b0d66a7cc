// The view's WebSocket: it keeps the newest frame only, reconnects, and reports it.

import { decodeFrame, decodeHello, encodeEcho } from "./protocol.js";

const RETRY_MS = [250, 500, 1000, 2000];

// What is waited for. A browser that trusts a certificate for one port only refuses the picture's without a word.
function waiting(address, attempts) {
  const { protocol, host } = new URL(address);
  if (protocol !== "wss:" || attempts < RETRY_MS.length) return "Waiting for the view to start…";
  return `The view does not answer yet. If it stays so, open https://${host}/healthz and accept the certificate there, too.`;
}

export class ViewStream {
  // Begins to connect. `handlers`, to be set in the same turn: onLayout(layout), onFrame() when one waits to be taken,
  // onRig(message), onLink(text or null). `find` promises the address as the rig knows it by then, or null: a view that
  // takes any free port has none before it runs, and another one after each start.
  constructor(address, find) {
    this.address = address;
    this.find = find;
    this.handlers = null;
    this.layout = null;
    this.newest = null;
    this.attempts = 0;
    this.came = 0;
    this.seen = false;
    this.wanted = null;
    this.afterPaint = new MessageChannel();
    this.afterPaint.port1.onmessage = ({ data }) => this.echo(data);
    this.connect();
  }

  connect() {
    const socket = new WebSocket(this.address);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      this.attempts = 0;
      this.seen = true;
      this.want(this.wanted);
      this.handlers.onLink(null);
    };
    socket.onmessage = ({ data }) => (typeof data === "string" ? this.text(data) : this.frame(data));
    socket.onclose = () => {
      this.layout = this.newest = null;
      this.handlers.onLink(this.seen ? "The view is not reachable. Trying again…" : waiting(this.address, this.attempts));
      this.retry = setTimeout(() => this.connectAnew(), RETRY_MS[Math.min(this.attempts++, RETRY_MS.length - 1)]);
    };
    this.socket = socket;
  }

  async connectAnew() {
    this.address = (await this.find()) ?? this.address;
    if (!this.ended) this.connect();
  }

  end() {
    this.ended = true;
    clearTimeout(this.retry);
    this.socket.onclose = this.socket.onopen = this.socket.onmessage = null;
    this.socket.close();
  }

  text(data) {
    const message = JSON.parse(data);
    if (message.type === "hello") this.hello = data;
    if (message.type === "rig") this.handlers.onRig(message);
    if (message.type !== "hello") return;
    this.layout = decodeHello(message);
    this.keeper?.setHello(this.hello);
    this.handlers.onLayout(this.layout);
  }

  frame(buffer) {
    this.keeper?.see(buffer); // before its numbers are changed to millimetres in place
    const frame = this.layout && decodeFrame(buffer, this.layout);
    if (!frame) return;
    this.newest = frame;
    this.came++;
    this.handlers.onFrame();
  }

  // Returns the number of frames since the last call.
  countCame() {
    const came = this.came;
    this.came = 0;
    return came;
  }

  // Tells the rig how many pictures a second this page can take; null: all.
  want(hz) {
    this.wanted = hz;
    if (this.socket?.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify({ type: "want", pictures_hz: hz }));
  }

  take() {
    const frame = this.newest;
    this.newest = null;
    return frame;
  }

  // Call in the animation frame that draws `frame`: its echo goes out when the browser has painted it.
  painted(frame) {
    this.afterPaint.port2.postMessage(frame.sequence);
  }

  echo(sequence) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(encodeEcho(sequence));
  }
}
