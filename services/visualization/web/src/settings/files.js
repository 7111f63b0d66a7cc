// Rig, scene and device files: the text, and beside it each key with what it means and what holds; saved only when sound.

import { element, text } from "../dashboard/rows.js";
import { t } from "../school/i18n.js";
import { boundsOf, shown, yamlOf } from "./values.js";

const CHECK_MS = 900;
const KINDS = { rig: "Rig", scene: "Scene", device: "Device" };

export class Files {
  // school: who keeps them; onStart(): begins the rig anew, a promise
  constructor(school, onStart) {
    Object.assign(this, { school, onStart });
    this.file = null;
  }

  async show({ files, running }) {
    this.names = files;
    this.runs = running;
    this.kind = element("select", { id: "file-kind", onchange: () => this.guard(() => this.list()) }, ...Object.entries(KINDS).map(([value, words]) => element("option", { value, textContent: t(words) })));
    this.name = element("select", { id: "file-name", onchange: () => this.guard(() => this.read()) });
    this.other = element("input", { id: "file-other", placeholder: t("a new name"), size: 14 });
    this.said = element("p", { id: "file-said", role: "status" });
    this.text = element("textarea", { id: "file-text", spellcheck: false, wrap: "off", oninput: () => this.changed() });
    this.find = element("input", { id: "file-find", type: "search", placeholder: t("find a key"), oninput: () => this.filter() });
    this.rows = element("tbody");
    for (const [node, words] of [[this.kind, "Kind of file"], [this.name, "File"], [this.other, "A new name"], [this.text, "Text of the file"], [this.find, "Find a key"]]) node.setAttribute("aria-label", t(words));
    const head = element("tr", {}, ...["Key", "Value", "From", "Meaning"].map((words) => element("th", { textContent: t(words) })));
    const buttons = [
      this.button("file-save", "Save", () => this.save(this.name.value, this.file.mark), "action go"),
      this.other, this.button("file-as", "Save as", () => this.saveAs()),
      element("span", { className: "grow" }), running.is_running ? this.button("file-start", "Start the rig anew", () => this.start()) : "",
    ];
    await this.list(true);
    return [
      element("section", {}, element("div", { className: "controls" }, this.kind, this.name, ...buttons), this.said, this.startedWith()),
      element("section", { className: "file" },
        element("div", { className: "file-keys" }, this.find, element("div", { className: "scroll" }, element("table", { className: "keys-table" }, element("thead", {}, head), this.rows))),
        this.text),
    ];
  }

  button(id, words, act, className = "") {
    const button = element("button", { id, className, textContent: t(words), onclick: async () => {
      button.disabled = true;
      await this.guard(act);
      button.disabled = false;
    } });
    return button;
  }

  startedWith() {
    const { rig, scene, overrides } = this.runs, set = overrides.length ? t(" Set at the start, and stronger than the files: {set}.", { set: overrides.join(", ") }) : "";
    const words = this.runs.is_running ? t("This rig runs by the rig file “{rig}” with the scene “{scene}”.", { rig, scene }) : t("No rig runs here. `trocar up` starts one.");
    return element("p", { className: "small", textContent: words + set });
  }

  async guard(act) {
    try {
      await act();
    } catch (error) {
      this.say(error.message, "bad");
    }
  }

  say(words, level = "good") {
    text(this.said, words);
    this.said.dataset.level = level;
  }

  async list(first = false) {
    const running = { rig: this.runs.rig, scene: this.runs.scene }[this.kind.value], names = this.names[this.kind.value];
    this.name.replaceChildren(...names.map((value) => element("option", { value, textContent: value === running && this.runs.is_running ? t("{name} (runs)", { name: value }) : value, selected: value === running })));
    if (!names.length) throw new Error(t("There is none."));
    if (first) return void this.guard(() => this.read());
    await this.read();
  }

  async read() {
    const kind = this.kind.value, name = this.name.value, asked = (this.reading = {});
    const found = await this.school.ask(`settings/files/${kind}/${name}`);
    if (asked !== this.reading) return; // another file was chosen since
    this.file = { kind, name, ...found };
    this.text.value = this.file.text;
    await this.check();
  }

  changed() {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.guard(() => this.check()), CHECK_MS);
  }

  // Asks whether the text is sound, and shows what would hold; a later text overtakes an earlier answer.
  async check() {
    clearTimeout(this.timer);
    const asked = (this.asked = {}), { kind, name } = this.file;
    this.say(t("Checking…"));
    try {
      const { rows } = await this.school.post("settings/check", { kind, name, text: this.text.value });
      if (asked !== this.asked) return;
      this.showRows(rows);
      this.say(this.text.value === this.file.text ? t("As it is kept.") : t("Sound, and not saved yet."));
    } catch (error) {
      if (asked === this.asked) throw error;
    }
  }

  showRows(rows) {
    this.rows.replaceChildren(...rows.map((row) => this.row(row)));
    this.filter();
  }

  row(row) {
    const { key, about, from } = row, control = this.control(row);
    control.setAttribute("aria-label", key);
    control.onchange = () => this.guard(() => this.set(row, control.value));
    const meaning = [about, boundsOf(row)].filter(Boolean).join("; ");
    const node = element("tr", {}, element("th", { scope: "row", textContent: key }), element("td", {}, control), element("td", { textContent: from === "file" ? t("this file") : from || t("default") }), element("td", { textContent: meaning }));
    node.dataset.words = `${key} ${about}`.toLowerCase();
    node.dataset.from = from === "file" ? "file" : "";
    return node;
  }

  control({ value, kind, choices, optional }) {
    const now = shown(value, kind), options = kind === "boolean" ? ["true", "false"] : kind === "choice" ? choices.map(String) : null;
    if (!options) return element("input", { value: now, spellcheck: false, inputMode: kind === "number" || kind === "integer" ? "decimal" : "text" });
    if (optional) options.unshift("");
    if (!options.includes(now)) options.push(now);
    return element("select", {}, ...options.map((each) => element("option", { value: each, textContent: each || "–", selected: each === now })));
  }

  // Changes one value in the text, and leaves everything else as it is.
  async set(row, typed) {
    const { text: changed } = await this.school.post("settings/edit", { text: this.text.value, key: row.key, value: yamlOf(typed, row) });
    this.text.value = changed;
    await this.check();
  }

  filter() {
    const words = this.find.value.trim().toLowerCase();
    for (const node of this.rows.children) node.hidden = Boolean(words) && !node.dataset.words.includes(words);
  }

  async saveAs() {
    const name = this.other.value.trim();
    if (!name) return this.other.focus();
    await this.save(name, "");
    this.names[this.kind.value] = [...this.names[this.kind.value], name].sort();
    this.other.value = "";
    await this.list();
    this.name.value = name;
    await this.read();
  }

  async save(name, mark) {
    const { kind } = this.file, kept = this.text.value;
    this.say(t("Checking…"));
    const { mark: next, rows } = await this.school.post("settings/save", { kind, name, text: kept, mark });
    this.file = { kind, name, text: kept, mark: next };
    this.showRows(rows);
    this.say(t("Saved. A rig that runs takes it at its next start."));
  }

  async start() {
    this.say(t("The files are checked; then the rig ends and begins anew, and every hand is let go."));
    await this.onStart();
    this.say(t("The rig begins anew…"));
  }
}
