// The page's words in the reader's language. An English sentence is its own key, as with gettext; what is missing stays English.

import ofSettings from "../settings/words.de.json" with { type: "json" };
import ofSchool from "./words.de.json" with { type: "json" };

const CATALOGUES = { de: { ...ofSettings, ...ofSchool } };
const KEY = "trocar-language";
export const LANGUAGES = { en: "English", de: "Deutsch" };

export let language = chosen();

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

// A sentence that the rig says: its numbers are no part of the key, which has {0}, {1} and so on in their place.
export function said(sentence = "") {
  if (!sentence || language === "en") return sentence;
  const numbers = [];
  const key = sentence.replace(/\d+(?:\.\d+)?/g, (number) => `{${numbers.push(number) - 1}}`);
  const found = CATALOGUES[language]?.[key] ?? CATALOGUES[language]?.[sentence];
  return found ? found.replace(/\{(\d+)\}/g, (_, i) => numbers[i] ?? "") : sentence;
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
