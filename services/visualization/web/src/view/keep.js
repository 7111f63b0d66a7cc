// Saves a picture or a film of the view as a file, without the rest of the page; it sends nothing.

const FILM_HZ = 30;
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
    this.recorder = new MediaRecorder(this.canvas.captureStream(FILM_HZ), { mimeType: this.format });
    this.recorder.ondataavailable = ({ data }) => data.size && parts.push(data);
    this.recorder.onstop = () => save(new Blob(parts, { type: this.format }), nameOf(this.format.slice(6, 10).replace(";", "")));
    this.recorder.start(1000);
  }

  end() {
    this.recorder?.stop();
    this.recorder = null;
  }
}
