// The page's words in the reader's language. An English sentence is its own key, as with gettext; what is missing stays English.

import ofRig from "../settings/rig.de.json" with { type: "json" };
import ofSettings from "../settings/words.de.json" with { type: "json" };
import ofSchool from "./words.de.json" with { type: "json" };

const CATALOGUES = { de: { ...ofRig, ...ofSettings, ...ofSchool } };
const KEY = "trocar-language";
export const LANGUAGES = { en: "English", de: "Deutsch" };

export let language = chosen();

// How dates are written: as the reader's country does, where it speaks the language chosen.
export const locale = () => globalThis.navigator?.languages?.find((each) => each.startsWith(language)) ?? language;

function chosen() {
  let kept = null;
  try {
    kept = globalThis.localStorage?.getItem(KEY);
  } catch {
    // this browser stores nothing for the page
  }
  const asked = kept ?? globalThis.navigator?.language?.slice(0, 2) ?? "en";
  return asked in LANGUAGES ? asked : "en";
}

export function setLanguage(name) {
  language = name in LANGUAGES ? name : "en";
  try {
    localStorage.setItem(KEY, language);
  } catch {
    // the choice lasts as long as the page is open
  }
}

// The sentence in the language chosen, with the values of its {names}.
export function t(sentence, values = {}) {
  const found = CATALOGUES[language]?.[sentence] ?? sentence;
  return found.replace(/\{(\w+)\}/g, (all, name) => (name in values ? String(values[name]) : all));
}

// Sentences that the rig puts values into, as patterns: those that say most come first, and "{0}: {1}" is for what none of them fits.
const PATTERNS = Object.fromEntries(Object.entries(CATALOGUES).map(([name, catalogue]) => [name, patternsOf(catalogue)]));

function patternsOf(catalogue) {
  const keys = Object.keys(catalogue).filter((key) => key.includes("{0}")), own = (key) => key.replace(/\{\d+\}/g, "").length;
  return keys.sort((a, b) => own(b) - own(a)).map((key) => ({ pattern: patternOf(key), words: catalogue[key] }));
}

// Several sentences may stand in one, as "left: …; right: …": only what comes last in a pattern may hold more than one.
function patternOf(key) {
  const parts = key.split(/\{\d+\}/).map((part) => part.replace(/[.*+?^$|(){}[\]\\]/g, "\\$&"));
  const hole = (i) => (i === parts.length - 2 && parts.at(-1) === "" ? "([^]+)" : i === 0 && parts[0] === "" ? "((?:(?!; |: )[^])+?)" : "((?:(?!; )[^])+?)");
  return new RegExp(`^${parts.map((part, i) => (i < parts.length - 1 ? part + hole(i) : part)).join("")}$`);
}

// A sentence that the rig says: the key has {0}, {1} and so on where it puts values in, which may be sentences themselves.
export function said(sentence = "") {
  if (!sentence || language === "en") return sentence;
  if (CATALOGUES[language][sentence]) return CATALOGUES[language][sentence];
  for (const { pattern, words } of PATTERNS[language]) {
    const found = pattern.exec(sentence);
    if (found) return words.replace(/\{(\d+)\}/g, (_, i) => said(found[Number(i) + 1]));
  }
  return sentence;
}

// Translates what the document says, once: texts, titles and labels of elements that are not filled by the page.
export function translatePage(root = document) {
  document.documentElement.lang = language;
  if (language === "en") return;
  const walker = document.createTreeWalker(root.body ?? root, NodeFilter.SHOW_TEXT);
  for (let node = walker.nextNode(); node; node = walker.nextNode()) {
    const words = node.nodeValue.trim();
    if (words && CATALOGUES[language][words]) node.nodeValue = node.nodeValue.replace(words, CATALOGUES[language][words]);
  }
  for (const name of ["title", "aria-label", "placeholder"]) {
    for (const node of (root.body ?? root).querySelectorAll(`[${name}]`)) node.setAttribute(name, t(node.getAttribute(name)));
  }
}
