// The page: the view on the left, the dashboard on the right. Everything it needs comes from the rig that serves it.

import { Controls } from "./dashboard/controls.js";
import { Dashboard } from "./dashboard/dashboard.js";
import { RigStream } from "./dashboard/stream.js";
import { Hands } from "./hands/hands.js";
import { viewAddress } from "./address.js";
import { ViewStream } from "./view/stream.js";
import { View } from "./view/view.js";

let view = null, hands = null;
const PICTURE_FIRST_MS = 5000;
const dashboard = new Dashboard({
  period: () => (view?.software ? (view.slow ? 3000 : 900) : 0),
  // Curves and tables were a seventh of what a computer that draws on its processor did until the first picture.
  waits: () => Boolean(view?.software && view.stream && !view.last) && performance.now() < PICTURE_FIRST_MS,
});
const controls = new Controls((token) => hands?.admit(token));
globalThis.trocar = { view, hands, dashboard }; // for whoever looks into the page with the browser's tools

const panel = document.getElementById("toggle-dashboard");
panel.onclick = () => {
  const alone = document.body.classList.toggle("alone");
  panel.setAttribute("aria-pressed", !alone);
};

const WITHOUT_PICTURE = {
  native: "The picture is in a window of the rig's own screen.",
  none: "This rig draws no picture (visualization.viewer: none).",
};

function makeView() {
  view = new View(() => dashboard.turn());
  hands = view.stage ? new Hands(view, controls.token) : null;
  Object.assign(globalThis.trocar, { view, hands });
}

// The connection is on its way while the stage is made, which takes a computer that draws on its processor a second or more.
function follow(rig) {
  const stream = rig.viewer in WITHOUT_PICTURE ? null : new ViewStream(viewAddress(rig.view_ws, location));
  if (!view) makeView();
  if (!stream) return view.say(WITHOUT_PICTURE[rig.viewer]);
  if (!view.stage) return stream.end();
  view.follow(stream);
  hands.offer(stream.address, rig.hands ?? []);
}

new RigStream({
  onRig: (rig) => {
    document.getElementById("rig-name").textContent = [rig.name, rig.scene].filter(Boolean).join(" · ");
    document.title = rig.name ? `Trocar · ${rig.name}` : "Trocar";
    dashboard.setContracts(rig.contracts);
    if (!view?.stream) follow(rig);
  },
  onState: (state) => dashboard.update(state),
  onLink: (text) => {
    dashboard.link(text);
    if (!view) makeView(); // no rig answers: the page is there all the same
  },
}, JSON.parse(document.getElementById("rig").textContent));
