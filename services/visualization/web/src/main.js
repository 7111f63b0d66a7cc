// The page: the view on the left, the dashboard on the right. Everything it needs comes from the rig that serves it.

import { Faces } from "./attempt/faces.js";
import { Instructor } from "./attempt/instructor.js";
import { Orders } from "./attempt/orders.js";
import { AttemptPanel } from "./attempt/panel.js";
import { ReplayBar } from "./attempt/replay.js";
import { Controls } from "./dashboard/controls.js";
import { Dashboard } from "./dashboard/dashboard.js";
import { startTold } from "./dashboard/format.js";
import { askRig, RigStream } from "./dashboard/stream.js";
import { Hands } from "./hands/hands.js";
import { ScopeHand } from "./hands/scope_hand.js";
import { translatePage } from "./school/i18n.js";
import { SchoolPage } from "./school/school.js";
import { SettingsPage } from "./settings/settings.js";
import { viewAddress } from "./address.js";
import { hear } from "./command.js";
import { ViewStream } from "./view/stream.js";
import { View } from "./view/view.js";
import { addStereo } from "./xr/stereo.js";

translatePage();
let view = null, hands = null, running = "";
const PICTURE_FIRST_MS = 5000;
const orders = new Orders((text, ok) => instructor.say(text, ok));
const instructor = new Instructor(orders), attempt = new AttemptPanel(orders), replay = new ReplayBar();
const school = new SchoolPage(orders, () => view, () => hands);
const settings = new SettingsPage(orders, school.sheet, () => view);
const dashboard = new Dashboard({
  peaks: () => view?.takePeaks() ?? [],
  period: () => (view?.software ? (view.slow ? 3000 : 900) : 0),
  // Curves and tables took a seventh of the work until the first picture on a computer that draws on its processor.
  waits: () => Boolean(view?.software && view.stream && !view.last) && performance.now() < PICTURE_FIRST_MS,
});
const controls = new Controls((token) => {
  orders.token = token;
  for (const each of [hands, attempt, instructor, school, settings]) each?.admit(token);
});
const faces = new Faces(document.getElementById("face"), () => view?.ask());
globalThis.trocar = { view, hands, dashboard, attempt, instructor, replay, school, settings }; // for whoever looks into the page with the browser's tools

const panel = document.getElementById("toggle-dashboard");
panel.onclick = () => {
  const alone = document.body.classList.toggle("alone");
  panel.setAttribute("aria-pressed", !alone);
};

// The keyboard alone reaches everything; while hands are held they use Tab, so this control has a key of its own.
addEventListener("keydown", (event) => {
  const typing = /^(INPUT|TEXTAREA|SELECT)$/.test(event.target?.tagName ?? "");
  if (event.code === "KeyB" && !typing && !event.repeat && !(event.ctrlKey || event.metaKey || event.altKey)) orders.ask("new");
});

const WITHOUT_PICTURE = {
  native: "The picture is in a window of the rig's own screen.",
  none: "This rig draws no picture (visualization.viewer: none).",
};

function makeView() {
  view = new View(() => dashboard.turn(), attempt);
  hands = view.stage ? new Hands(view, controls.token) : null;
  const scopeHand = view.stage ? new ScopeHand(view, hands) : null;
  Object.assign(globalThis.trocar, { view, hands, scopeHand, stereo: addStereo(view, hands) });
}

// Returns where the picture is now, null where nobody answers.
async function findView() {
  const rig = await askRig().catch(() => null);
  return rig && viewAddress(rig.view_ws, location);
}

// The connection is on its way while the stage is made, which takes a computer that draws on its processor a second or more.
function follow(rig) {
  const stream = rig.viewer in WITHOUT_PICTURE ? null : new ViewStream(viewAddress(rig.view_ws, location), findView);
  if (!view) makeView();
  if (!stream) return view.say(WITHOUT_PICTURE[rig.viewer]);
  if (!view.stage) return stream.end();
  stream.keeper = school.keeper;
  school.keeper.eye = () => view.stage?.eye();
  if (stream.hello) school.keeper.setHello(stream.hello);
  view.follow(stream);
  hands.offer(stream, rig.hands ?? []);
}

const told = JSON.parse(document.getElementById("rig").textContent);
if (told?.settings) settings.openAlone(); // no rig runs: `trocar settings` serves this page
else new RigStream({
  onRig: (rig) => {
    const begun = `${rig.name} ${rig.scene} ${rig.scenario} ${rig.goes_on_from ?? ""}`;
    if (running && running !== begun) return location.reload(); // another scenario: nothing of the last one is kept
    running = begun;
    document.getElementById("rig-name").textContent = [rig.name, rig.scene].filter(Boolean).join(" · ");
    document.title = rig.name ? `Trocar · ${rig.name}` : "Trocar";
    dashboard.setContracts(rig.contracts);
    faces.setHands(Boolean(rig.hands?.length));
    instructor.setRig(rig);
    school.setRig(rig);
    if (!view?.stream) follow(rig);
  },
  onState: (state) => {
    hear(state);
    attempt.update(state.attempt, state.safe_stop || state.state === "safe_stop");
    instructor.update(state.attempt);
    school.update(state.attempt);
    settings.update(state);
    replay.update(state.replay);
    if (state.attempt && view?.stage) view.startMirrored(state.attempt.mirrored);
    dashboard.update(state);
    view?.tellStart(view.last ? "" : startTold(state));
  },
  onLink: (text) => {
    dashboard.link(text);
    if (!view) makeView(); // no rig answers: the page is there all the same
  },
}, told);
