// The face of the page: for a trainee, an engineer or an instructor. The address may name it (#face=), else the last choice counts.

export const FACES = ["trainee", "engineer", "instructor"];
const KEY = "trocar-face";

export function faceOf(hash, kept, hasHands) {
  const said = new URLSearchParams(hash.slice(1)).get("face");
  if (FACES.includes(said)) return said;
  if (FACES.includes(kept)) return kept;
  return hasHands ? "trainee" : "engineer";
}

export class Faces {
  // select: the element to choose with; onFace(face)
  constructor(select, onFace) {
    this.select = select;
    this.onFace = onFace;
    this.hasHands = false;
    select.onchange = () => {
      keep(select.value);
      const said = new URLSearchParams(location.hash.slice(1));
      if (said.has("face")) {
        said.set("face", select.value);
        history.replaceState(null, "", `#${said}`);
      }
      this.show();
    };
    addEventListener("hashchange", () => this.show());
    this.show();
  }

  // Sets whether a person at the page may hold instruments: then the face is a trainee's, unless one was chosen.
  setHands(hasHands) {
    this.hasHands = hasHands;
    this.show();
  }

  show() {
    const face = faceOf(location.hash, kept(), this.hasHands);
    this.select.value = face;
    if (document.body.dataset.face === face) return;
    document.body.dataset.face = face;
    this.onFace(face);
  }
}

function kept() {
  try {
    return localStorage.getItem(KEY);
  } catch {
    return null;
  }
}

function keep(face) {
  try {
    localStorage.setItem(KEY, face);
  } catch {
    // this browser stores nothing for the page: the choice lasts as long as the page is open
  }
}
