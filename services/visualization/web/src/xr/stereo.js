// Two ways to see depth, each a button beside those of the camera: a headset, and two pictures side by side.

import { t } from "../school/i18n.js";
import { Headset, whyNone } from "./headset.js";
import { SideBySide } from "./side_by_side.js";

export function addStereo(view, hands) {
  if (!view.stage) return null;
  const row = document.getElementById("camera-tools");
  const sides = new SideBySide(view);
  const beside = newButton(row, t("Side by side"), t("A picture for each eye, for a projector or screen with glasses"));
  beside.onclick = () => {
    if (headset.session) return;
    sides.switch(!sides.on);
    beside.setAttribute("aria-pressed", sides.on);
  };
  const headset = new Headset(view, hands, () => {
    into.setAttribute("aria-pressed", Boolean(headset.session));
    if (!headset.session && sides.on) sides.switch(true);
  });
  const into = newButton(row, t("Headset"), "");
  into.onclick = () => headset.toggle().catch((error) => (into.title = t("The headset was not opened: {why}", { why: error.message })));
  const tell = async () => {
    const why = await whyNone();
    into.disabled = Boolean(why);
    into.title = t(why || "Stand before the duct; grips hold it, triggers close the jaws");
  };
  navigator.xr?.addEventListener?.("devicechange", tell);
  const told = tell();
  return { headset, sides, told, whyNone };
}

function newButton(row, text, title) {
  const button = Object.assign(document.createElement("button"), { textContent: text, title });
  button.setAttribute("aria-pressed", "false");
  row.append(button);
  return button;
}
