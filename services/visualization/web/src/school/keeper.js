// Keeps the pictures of an attempt while it is made, and from where they were seen, and sends them to the school when it has ended:
// what a replay shows.

const HZ = 12;
const MOST_FRAMES = 12 * 600;

export class Keeper {
  constructor(school) {
    this.school = school;
    this.hello = null;
    this.eye = () => null; // where the page's eye is, see `Stage.eye`
    this.begin("");
  }

  begin(id) {
    this.id = id;
    this.frames = [];
    this.seen = []; // [frame from which on, eye]
    this.due = 0;
  }

  // The layout's text, as it came.
  setHello(text) {
    this.hello = text;
  }

  // A frame as it came; twelve a second are kept.
  see(buffer, now = performance.now()) {
    if (!this.id || now < this.due || this.frames.length >= MOST_FRAMES) return;
    this.due = Math.max(this.due + 1000 / HZ, now - 1000 / HZ);
    const eye = this.eye();
    if (eye && String(eye) !== String(this.seen.at(-1)?.[1])) this.seen.push([this.frames.length, eye]);
    this.frames.push(buffer.slice(0));
  }

  // Follows the attempt; resolves once the pictures of one that has ended are sent.
  async follow(attempt) {
    if (!attempt) return;
    if (attempt.state === "running" && attempt.attempt_id !== this.id) this.begin(attempt.attempt_id);
    if (attempt.state !== "done" || attempt.attempt_id !== this.id || !this.frames.length) return;
    const { id, frames, hello, seen } = this;
    this.begin("");
    await this.school.ask(`replay/${id}`, { method: "PUT", body: await packed(JSON.stringify({ ...JSON.parse(hello), seen }), frames) });
  }
}

// One file: the length of the hello, the hello, then of each frame its length and bytes; compressed.
export async function packed(hello, frames) {
  const head = new TextEncoder().encode(hello), parts = [length(head.length), head];
  for (const frame of frames) parts.push(length(frame.byteLength), new Uint8Array(frame));
  const stream = new Blob(parts).stream().pipeThrough(new CompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

export async function unpacked(data) {
  const stream = new Blob([data]).stream().pipeThrough(new DecompressionStream("gzip"));
  const bytes = await new Response(stream).arrayBuffer(), view = new DataView(bytes);
  const n = view.getUint32(0, true), hello = new TextDecoder().decode(new Uint8Array(bytes, 4, n)), frames = [];
  for (let at = 4 + n; at + 4 <= bytes.byteLength; ) {
    const size = view.getUint32(at, true);
    frames.push(bytes.slice(at + 4, at + 4 + size));
    at += 4 + size;
  }
  return { hello: JSON.parse(hello), frames };
}

function length(n) {
  const four = new Uint8Array(4);
  new DataView(four.buffer).setUint32(0, n, true);
  return four;
}
