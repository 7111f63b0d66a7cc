// The page: the view on the left, the dashboard on the right. Everything it needs comes from the rig that serves it.

import { Controls } from "./dashboard/controls.js";
import { Dashboard } from "./dashboard/dashboard.js";
import { RigStream } from "./dashboard/stream.js";
import { Hands } from "./hands/hands.js";
import { viewAddress } from "./address.js";
import { View } from "./view/view.js";

const view = new View(() => dashboard.turn());
const dashboard = new Dashboard({ period: () => (view.software ? (view.slow ? 3000 : 900) : 0) });
const controls = new Controls();
const hands = view.stage ? new Hands(view, controls.token) : null;
globalThis.trocar = { view, hands, dashboard }; // for whoever looks into the page with the browser's tools

const panel = document.getElementById("toggle-dashboard");
panel.onclick = () => {
  const alone = document.body.classList.toggle("alone");
  panel.setAttribute("aria-pressed", !alone);
};

new RigStream({
  onRig: (rig) => {
    document.getElementById("rig-name").textContent = [rig.name, rig.scene].filter(Boolean).join(" · ");
    document.title = rig.name ? `Trocar · ${rig.name}` : "Trocar";
    dashboard.setContracts(rig.contracts);
    if (rig.viewer === "native") view.say("The picture is in a window of the rig's own screen.");
    else if (rig.viewer === "none") view.say("This rig draws no picture (visualization.viewer: none).");
    else {
      const address = viewAddress(rig.view_ws, location);
      view.connect(address);
      hands?.offer(address, rig.hands ?? []);
    }
  },
  onState: (state) => dashboard.update(state),
  onLink: (text) => dashboard.link(text),
});
