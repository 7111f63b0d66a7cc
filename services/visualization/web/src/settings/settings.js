// The settings of a rig, for an engineer or an instructor: files, devices, recordings and logs, in the sheet over the picture.

import { element, text } from "../dashboard/rows.js";
import { School } from "../school/client.js";
import { locale, t } from "../school/i18n.js";
import { Devices } from "./devices.js";
import { Files } from "./files.js";
import { bytes, share } from "./values.js";

const $ = (id) => document.getElementById(id);
const TABS = { files: "Files", devices: "Devices", disk: "Recordings", logs: "Logs" };

export class SettingsPage {
  // orders: of the attempt, for a new start; sheet: where it is shown; view(): as it is now
  constructor(orders, sheet, view) {
    Object.assign(this, { orders, sheet, view });
    this.school = new School();
    $("settings-open").onclick = () => this.open("files");
  }

  admit(token) {
    this.school.token = token;
    $("settings-open").hidden = !token;
  }

  // Shows the settings where no rig runs, and nothing else of the page.
  openAlone() {
    document.body.classList.add("alone", "settings-only");
    document.title = `Trocar · ${t("Settings")}`;
    this.open("files");
  }

  // The rig's state, five times a second.
  update(state) {
    if (this.before !== undefined && state.incarnation !== this.before) location.reload(); // it has begun anew
    this.incarnation = state.incarnation;
    if (this.sheet.open) this.devices?.update(state);
  }

  // Shows a part; one that is asked for later overtakes it.
  async open(tab) {
    const asked = (this.asked = {});
    this.devices = null;
    this.sheet.show(t("Settings"));
    const tabs = element("div", { className: "tabs settings-tabs", role: "tablist" }, ...Object.entries(TABS).map(([name, words]) => this.tab(name, words, tab)));
    const body = element("div", { className: "settings" });
    $("sheet-body").replaceChildren(element("div", { className: "wide" }, tabs, body));
    body.replaceChildren(element("p", { className: "small", role: "status", textContent: t("Loading…") }));
    try {
      const shown = await this[`show_${tab}`]();
      if (asked === this.asked) body.replaceChildren(...shown);
    } catch (error) {
      body.replaceChildren(element("p", { className: "message", role: "alert", textContent: error.message }));
    }
  }

  tab(name, words, chosen) {
    const button = element("button", { id: `settings-${name}`, role: "tab", textContent: t(words), onclick: () => this.open(name) });
    button.setAttribute("aria-selected", String(name === chosen));
    return button;
  }

  async show_files() {
    return new Files(this.school, () => this.startAnew()).show(await this.school.ask("settings"));
  }

  async show_devices() {
    const { running } = await this.school.ask("settings");
    this.devices = new Devices(this.school, this.view);
    return this.devices.show(running);
  }

  async show_disk() {
    const { folder, files, bytes: used, free, total, replays, n_replays: n, records } = await this.school.ask("settings/disk");
    const meter = element("meter", { min: 0, max: total, value: total - free, high: 0.9 * total });
    meter.setAttribute("aria-label", t("How full the disk is"));
    const told = [
      t("{used} in {n} recordings in {folder}.", { used: bytes(used), n: files.length, folder }),
      t("{free} of {total} are free ({share}).", { free: bytes(free), total: bytes(total), share: share(free, total) }),
      t("{used} in {n} files of replays and pictures.", { used: bytes(replays), n }),
      records ? "" : t("This rig records nothing: its recorder is off."),
    ];
    return [
      element("section", {}, element("h2", { textContent: t("Disk of the recordings") }), meter, ...told.filter(Boolean).map((words) => element("p", { textContent: words }))),
      element("section", {}, element("h2", { textContent: t("Recordings") }), listOf(files, t("None yet."))),
    ];
  }

  async show_logs() {
    const logs = await this.school.ask("settings/logs"), shown = element("pre", { className: "log", tabIndex: 0 });
    shown.setAttribute("aria-label", t("Log"));
    const read = async (name) => {
      const found = await this.school.ask(`settings/logs/${name}`).catch((error) => ({ text: error.message }));
      text(shown, (found.cut ? `${t("[the end of it]")}\n` : "") + (found.text || t("It says nothing.")));
      shown.scrollTop = shown.scrollHeight;
    };
    const choice = element("select", { id: "settings-log", onchange: () => read(choice.value) }, ...logs.map(({ name, bytes: size }) => element("option", { value: name, textContent: `${name} (${bytes(size)})` })));
    choice.setAttribute("aria-label", t("Log"));
    if (logs.length) await read(logs[0].name);
    const none = logs.length ? "" : element("p", { textContent: t("None yet.") });
    return [element("section", {}, element("div", { className: "controls" }, choice, element("button", { textContent: t("Read again"), onclick: () => read(choice.value) })), none, shown)];
  }

  // Ends the rig and begins it with what its files say now, once they are known to be sound.
  async startAnew() {
    await this.school.post("settings/start");
    const ends = this.incarnation;
    const answer = await this.orders.post("api/restart", "");
    if (answer?.ok) this.before = ends;
    if (answer && !answer.ok) throw new Error(answer.text);
  }
}

function listOf(files, none) {
  if (!files.length) return element("p", { textContent: none });
  const rows = files.map(({ name, bytes: size, at_s: at }) => element("tr", {}, ...[name, bytes(size), new Date(1000 * at).toLocaleString(locale())].map((words) => element("td", { textContent: words }))));
  const head = element("tr", {}, ...["File", "Size", "Written"].map((words) => element("th", { textContent: t(words) })));
  return element("div", { className: "scroll", tabIndex: 0 }, element("table", { className: "plain" }, element("thead", {}, head), element("tbody", {}, ...rows)));
}
