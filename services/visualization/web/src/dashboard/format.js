// Numbers as people read them. Unknown is a dash.

import { said, t } from "../school/i18n.js";

export const known = (x) => typeof x === "number" && Number.isFinite(x);

export function us(x) {
  if (!known(x)) return "–";
  if (x >= 1000000) return `${(x / 1000000).toPrecision(3)} s`;
  if (x >= 100000) return `${(x / 1000).toFixed(0)} ms`;
  if (x >= 1000) return `${(x / 1000).toFixed(x < 10000 ? 2 : 1)} ms`;
  return x >= 100 ? x.toFixed(0) : x.toFixed(1);
}

export const usWithUnit = (x) => (x < 1000 ? `${us(x)} µs` : us(x));

export function hz(x) {
  if (!known(x)) return "–";
  return x >= 100 ? x.toFixed(0) : x.toFixed(1);
}

export function share(x) {
  if (!known(x)) return "–";
  if (x === 0) return "0";
  if (x < 0.0001) return `${(1e6 * x).toFixed(0)} ppm`;
  return `${x < 0.1 ? (100 * x).toPrecision(2) : (100 * x).toFixed(0)} %`;
}

export function count(x) {
  return known(x) ? String(x) : "–";
}

// The counts of what a process dropped or refused, and the time that it did not let happen, from its gauges.
export function losses(gauges) {
  const counts = Object.entries(gauges ?? {}).filter(([name, n]) => /^(dropped|refused)_/.test(name) && n > 0)
    .map(([name, n]) => `${name.replaceAll("_", " ")} ${count(n)}`);
  const withheld = gauges?.withheld_s > 0 ? [`withheld ${usWithUnit(1e6 * gauges.withheld_s)}`] : [];
  return [...counts, ...withheld].join(", ");
}

// The load of the busiest CAN bus, from the gateway's gauges.
export function busLoad(gauges) {
  const loads = Object.entries(gauges ?? {}).filter(([name, x]) => name.startsWith("bus_load.") && known(x)).map(([, x]) => x);
  return loads.length ? `CAN ${share(Math.max(...loads))} full` : "";
}

export function duration(s) {
  if (!known(s)) return "–";
  if (s < 100) return `${s.toFixed(0)} s`;
  return s < 6000 ? `${(s / 60).toFixed(0)} min` : `${(s / 3600).toFixed(1)} h`;
}

export function percent(x) {
  return known(x) ? `${x === 1 ? 100 : (100 * x).toFixed(2)} %` : "–";
}

export function force(newton) {
  if (!known(newton)) return "–";
  return newton < 0.0995 ? `${(1000 * newton).toFixed(newton < 0.00995 ? 1 : 0)} mN` : `${newton.toFixed(2)} N`;
}

// The quality that the governor gave up for time, and its cost in accuracy where that was measured.
export function givenUp({ quality_level: level, quality }) {
  if (!(level > 0)) return "";
  const off = [["force", quality?.force_error_percent], ["motion", quality?.motion_error_percent]]
    .filter(([, error]) => known(error)).map(([of, error]) => `${of} off by ${error} %`);
  const rung = quality?.name ? ` of ${quality.rungs - 1}: ${quality.name}` : "";
  return [`quality level ${level}${rung}`, ...off].join(", ");
}

// What is told in the place of the picture while the rig starts: how far the slowest process is, and why it takes long.
export function startTold(state) {
  if (state.state !== "starting") return "";
  const begun = (state.processes ?? []).filter((process) => process.start?.[1] > 0).map(({ name, start }) => ({ name, stage: start[0], share: start[1] }));
  const slowest = begun.sort((a, b) => a.share - b.share)[0];
  const now = slowest ? `${slowest.name} ${Math.floor(100 * slowest.share)} %, ${said(slowest.stage)}` : t("The rig is starting");
  const notice = said(state.start_notice);
  return notice ? `${notice[0].toUpperCase()}${notice.slice(1)}. ${now}` : now;
}
