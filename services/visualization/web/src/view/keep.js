// Saves a picture or a film of the view as a file, without the rest of the page; it sends nothing.

const FILM_HZ = 30;
const SLICE_MS = 100;
const FORMATS = ["video/webm;codecs=vp9", "video/webm;codecs=vp8", "video/webm", "video/mp4"];

export function nameOf(kind, now = new Date()) {
  return `trocar-${now.toISOString().slice(0, 19).replace(/[:T]/g, "-")}.${kind}`;
}

export function save(blob, name) {
  const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(blob), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

export class Film {
  constructor(canvas) {
    this.canvas = canvas;
    this.format = globalThis.MediaRecorder && FORMATS.find((format) => MediaRecorder.isTypeSupported(format));
  }

  begin() {
    const parts = [];
    const recorder = new MediaRecorder(this.canvas.captureStream(FILM_HZ), { mimeType: this.format });
    recorder.ondataavailable = ({ data }) => {
      if (data.size) parts.push(data);
      if (this.recorder !== recorder && recorder.state === "recording" && parts.length) recorder.stop();
    };
    recorder.onstop = () => save(new Blob(parts, { type: this.format }), nameOf(this.format.slice(6, 10).replace(";", "")));
    recorder.start(SLICE_MS);
    this.recorder = recorder;
    this.parts = parts;
  }

  // A film that has no picture yet ends with its first one: a file without any would be empty.
  end() {
    if (this.parts?.length) this.recorder.stop();
    this.recorder = this.parts = null;
  }
}
