// The parts of the dashboard that are text: processes, work, topics, stages, real-time facts, events.

import { busLoad, count, duration, hz, known, losses, share, us, usWithUnit } from "./format.js";
import { element, Rows, tableRow, text } from "./rows.js";

const $ = (id) => document.getElementById(id);
const body = (id) => $(id).querySelector("tbody");

function levelOf(process) {
  if (["failed", "dead", "lost", "stopped", "hung"].includes(process.state)) return "bad";
  if (process.state === "degraded" || process.loop?.contract_ok === false) return "warn";
  return ["ready", "running"].includes(process.state) ? "good" : "";
}

export class Processes {
  constructor() {
    this.rows = new Rows($("processes"), () => element("div", { className: "tile" },
      element("strong", {}, element("span"), element("em")), element("div", { className: "numbers" }),
      element("div", { className: "numbers" }), element("div", { className: "numbers muted" }),
      element("div", { className: "numbers warn" })), (tile, process) => this.fill(tile, process));
  }

  fill(tile, process) {
    const [head, rate, late, rest, missed] = tile.children, { loop } = process;
    tile.dataset.level = levelOf(process);
    tile.title = process.reason || "";
    text(head.firstChild, process.name);
    text(head.lastChild, process.state);
    const starting = process.start && !loop;
    if (starting) text(rate, `${Math.floor(100 * process.start[1])} % ${process.start[0]}`);
    else text(rate, loop ? `${hz(loop.rate_hz)} of ${hz(loop.target_hz)} Hz` : "no loop");
    rate.title = starting ? process.start[0] : "";
    tile.style.setProperty("--started", starting ? `${100 * process.start[1]}%` : "0%");
    text(late, loop ? `late ${share(loop.miss_ratio)}` : "");
    text(rest, [`up ${duration(process.uptime_s)}`, `restarts ${count(process.restarts)}`, busLoad(process.gauges)].filter(Boolean).join(", "));
    rest.title = rest.textContent;
    text(missed, losses(process.gauges));
    missed.title = missed.textContent;
  }

  update(processes) {
    this.rows.update(processes, (process) => process.name);
  }
}

export class Budget {
  constructor() {
    this.rows = new Rows($("budget"), () => element("div", { className: "load" }, element("span"),
      element("div", { className: "track" }, element("i"), element("u"), element("s")), element("span", { className: "numbers" })),
    (row, { name, loop }) => {
      const period = 1e6 / loop.target_hz, part = (x) => (known(x) ? Math.min(1, x / period) : 0);
      const [label, track, numbers] = row.children, [bar, line, dot] = track.children;
      text(label, name);
      bar.style.width = `${100 * part(loop.work_us?.p50)}%`;
      line.style.left = `calc(${100 * part(loop.work_us?.p99)}% - 1px)`;
      dot.style.left = `calc(${100 * part(loop.work_us?.max)}% - 4px)`;
      text(numbers, `${us(loop.work_us?.p50)} · ${us(loop.work_us?.p99)} · ${us(loop.work_us?.max)}`);
      row.title = `p50, p99 and max of the work of a tick; the whole bar is ${usWithUnit(period)}`;
    });
  }

  update(processes) {
    this.rows.update(processes.filter((process) => process.loop?.target_hz), (process) => process.name);
  }
}

function fillTopic(row, topic) {
  const refused = Object.entries(topic.refused ?? {}), cells = row.children;
  const lost = (topic.drops ?? 0) > 0, bad = refused.length > 0;
  [topic.topic, hz(topic.rate_hz), hz(topic.target_hz), us(topic.age_us?.p99), count(topic.drops),
    refused.map(([reason, n]) => `${reason} ${n}`).join(", ") || "0"].forEach((value, i) => text(cells[i], value));
  cells[1].className = known(topic.rate_hz) && topic.rate_hz < 0.95 * topic.target_hz ? "warn" : "";
  cells[4].className = lost ? "warn" : "";
  cells[5].className = bad ? "bad" : "";
  row.title = `published by ${topic.publisher}; age p50 ${us(topic.age_us?.p50)}, max ${usWithUnit(topic.age_us?.max)}; replaced unread ${count(topic.superseded)}`;
}

export class Topics {
  constructor() {
    this.rows = new Rows(body("topics"), () => tableRow(6), fillTopic);
  }

  update(topics) {
    this.rows.update(topics, (topic) => topic.topic);
  }
}

export class Stages {
  constructor() {
    this.groups = new Rows($("stages"), ({ name }) => {
      const group = element("div", { className: "stage-group" }, element("h3", { textContent: name }));
      group.rows = new Rows(group, () => element("div", { className: "stage" }, element("span"),
        element("b", {}, element("i"), element("u")), element("span", { className: "numbers" })), (row, { stage, most }) => {
        const [label, bar, numbers] = row.children, part = (x) => `${known(x) ? Math.min(100, (100 * x) / most) : 0}%`;
        text(label, stage.name);
        bar.firstChild.style.width = part(stage.p50_us);
        bar.lastChild.style.left = `calc(${part(stage.p99_us)} - 2px)`;
        text(numbers, [stage.p50_us, stage.p99_us, stage.max_us].map(us).join(" · "));
      });
      return group;
    }, (group, process) => {
      const most = Math.max(1e-9, ...process.stages.map((stage) => stage.p99_us ?? 0));
      group.rows.update(process.stages.map((stage) => ({ stage, most })), ({ stage }) => stage.name);
    });
  }

  update(processes) {
    this.groups.update(processes.filter((process) => process.stages?.length), (process) => process.name);
  }
}

// The kernel's counts for each process in the last second.
export class Threads {
  constructor() {
    this.rows = new Rows(body("threads"), () => tableRow(5), (row, { name, usage }) => {
      [name, hz(usage.wakeups_per_s), hz(usage.switches_per_s), share(usage.processor_share), share(usage.waited_share)]
        .forEach((value, i) => text(row.children[i], value));
    });
  }

  update(processes) {
    const known = processes.filter((process) => process.usage);
    const sum = (key) => known.reduce((total, { usage }) => total + usage[key], 0);
    const keys = ["wakeups_per_s", "switches_per_s", "processor_share", "waited_share"];
    const all = { name: "together", usage: Object.fromEntries(keys.map((key) => [key, sum(key)])) };
    this.rows.update(known.length ? [...known, all] : [], (process) => process.name);
  }
}

export class Realtime {
  constructor() {
    this.rows = new Rows(body("realtime"), () => tableRow(4), (row, { process, fact }) => {
      [process, fact.name, fact.asked, fact.had].forEach((value, i) => text(row.children[i], value));
      row.children[3].className = fact.ok ? "" : "warn";
    });
  }

  update(processes) {
    const facts = processes.flatMap((process) => (process.realtime ?? []).map((fact) => ({ process: process.name, fact })));
    const missed = facts.filter(({ fact }) => !fact.ok);
    text($("realtime-sum"), facts.length ? `${facts.length - missed.length} of ${facts.length} as asked` : "");
    facts.sort((a, b) => a.fact.ok - b.fact.ok);
    const order = facts.map(({ process, fact }) => `${process} ${fact.name} ${fact.ok}`).join();
    if (order !== this.order) this.rows.update([], () => "");
    this.order = order;
    this.rows.update(facts, ({ process, fact }) => `${process} ${fact.name}`);
  }
}

// How late the process that judges the others is itself.
export class Judge {
  update(judge) {
    text($("judge"), judge
      ? `The supervisor judges ${hz(judge.rate_hz)} times a second, now at most ${usWithUnit(judge.lateness_us.max)} late, since its start ${usWithUnit(judge.latest_us)}.`
      : "");
  }
}

export class Events {
  update(events) {
    const key = events.length ? `${events.length} ${events.at(-1).t} ${events.at(-1).text}` : "";
    if (key === this.key) return;
    this.key = key;
    const rows = events.slice().reverse().map((event) => {
      const row = element("li", {}, element("time", { textContent: `${event.t.toFixed(1)} s` }), element("span", { textContent: event.text }));
      row.dataset.level = event.level;
      return row;
    });
    $("events").replaceChildren(...(rows.length ? rows : [element("li", { className: "empty", textContent: "Nothing has happened yet." })]));
  }
}
