// Replay of a recording's pictures: its time and its controls. A report's marks lead to a moment (#replay=FILE&at=SECOND).

import { text } from "../dashboard/rows.js";
import { said, t } from "../school/i18n.js";
import { clock } from "./words.js";

const $ = (id) => document.getElementById(id);

// The moment that an address names, null for none.
export function momentOf(hash) {
  const said = new URLSearchParams(hash.slice(1));
  const file = said.get("replay"), at = Number(said.get("at") ?? 0);
  return file && at >= 0 && Number.isFinite(at) ? { file, at } : null;
}

// The sentence on how to see a moment that this rig cannot show.
export function howToSee({ file, at }, shown) {
  const now = shown ? t("This page shows {shown}.", { shown }) : t("This rig works, and shows no recording.");
  return `${now} ${t("To see second {at} of {file}: end it, and run", { at: at.toFixed(1), file })}`;
}

// Quotes a name for a shell.
export const commandFor = ({ file, at }) => `trocar replay '${file.replaceAll("'", "'\\''")}' --pictures --from ${at.toFixed(2)}`;

export class ReplayBar {
  constructor() {
    this.replay = undefined; // not told yet; null where this rig shows none
    this.moment = momentOf(location.hash);
    addEventListener("hashchange", () => {
      this.moment = momentOf(location.hash);
      this.follow();
    });
    for (const button of document.querySelectorAll("#replay [data-line]")) button.onclick = () => this.ask(button.dataset.line);
    $("replay-place").onchange = () => this.ask(`@${$("replay-place").value}`);
    $("replay-rate").onchange = () => this.ask(`x${$("replay-rate").value}`);
    $("replay-close").onclick = () => ($("replay-elsewhere").hidden = true);
  }

  async ask(line) {
    try {
      const answer = await fetch("api/replay", { method: "POST", headers: { "X-Trocar-Replay": "1" }, body: line });
      if (!answer.ok) text($("replay-time"), said((await answer.json()).error));
    } catch {
      // the link says that nobody is there
    }
  }

  // Goes to the moment that the address names, once; if this rig cannot show it, the page says how to.
  async follow() {
    const { moment, replay } = this;
    if (!moment || replay === undefined) return;
    this.moment = null;
    const here = replay?.file === moment.file;
    $("replay-elsewhere").hidden = here;
    text($("replay-how"), here ? "" : howToSee(moment, replay?.file));
    text($("replay-command"), here ? "" : commandFor(moment));
    if (!here) return;
    await this.ask(`@${moment.at}`);
    if (replay.halted) await this.ask("");
  }

  update(replay) {
    this.replay = replay ?? null;
    this.follow();
    $("replay").hidden = !replay;
    if (!replay) return;
    const { place_s: place, length_s: length, halted, rate, loop } = replay;
    text($("replay-file"), replay.file);
    text($("replay-time"), `${clock(place)}.${Math.floor((place * 10) % 10)} ${t("of {time}", { time: clock(length) })}`);
    text($("replay-halt"), halted ? t("Play") : t("Halt"));
    $("replay-loop").setAttribute("aria-pressed", loop);
    $("replay-place").max = length.toFixed(2);
    for (const [control, value] of [[$("replay-place"), place.toFixed(2)], [$("replay-rate"), String(rate)]]) {
      if (document.activeElement !== control) control.value = value;
    }
  }
}
