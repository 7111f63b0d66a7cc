// Values of settings, between what a person types and YAML.

const UNITS = ["B", "kB", "MB", "GB", "TB"];

export function bytes(count) {
  let at = 0;
  for (; count >= 1000 && at < UNITS.length - 1; at++) count /= 1000;
  return `${count >= 100 || at === 0 ? Math.round(count) : count.toFixed(1)} ${UNITS[at]}`;
}

export const share = (part, whole) => `${Math.round((100 * part) / Math.max(1, whole))} %`;

// What a control shows of a value.
export function shown(value, kind) {
  if (value === null || value === undefined) return "";
  return kind === "string" || kind === "choice" ? String(value) : typeof value === "string" ? value : JSON.stringify(value);
}

// Words that YAML would take for something else, or that end a value, are quoted.
const PLAIN = /^[A-Za-z_][\w./-]*( [\w./-]+)*$/, OTHER = /^(true|false|null|yes|no|on|off|y|n)$/i;

// The YAML of what a person has typed or chosen for a key.
export function yamlOf(typed, { kind, optional, choices = [] }) {
  if (typed === "" && (optional || kind !== "string")) return "null";
  if (kind === "choice") return choices.some((each) => typeof each !== "string" && String(each) === typed) ? typed : quoted(typed);
  return kind === "string" ? quoted(typed) : typed;
}

const quoted = (words) => (PLAIN.test(words) && !OTHER.test(words) ? words : JSON.stringify(words));

// What a key may be, in words for whom reads its row.
export function boundsOf({ least, above, most, below }) {
  const from = least !== undefined ? `≥ ${least}` : above !== undefined ? `> ${above}` : "";
  const to = most !== undefined ? `≤ ${most}` : below !== undefined ? `< ${below}` : "";
  return [from, to].filter(Boolean).join(", ");
}
