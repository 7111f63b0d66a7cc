// The page's words in the reader's language.

import ofAnswers from "../../../../messages/answers.de.json" with { type: "json" };
import { Catalogue } from "../../../../messages/said.mjs";
import ofRig from "../settings/rig.de.json" with { type: "json" };
import ofSettings from "../settings/words.de.json" with { type: "json" };
import ofSchool from "./words.de.json" with { type: "json" };

const CATALOGUES = { en: new Catalogue(), de: new Catalogue({ ...ofAnswers, ...ofRig, ...ofSettings, ...ofSchool }) };
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
export const t = (sentence, values) => CATALOGUES[language].t(sentence, values);

// A sentence that the rig says, in the language chosen.
export const said = (sentence) => CATALOGUES[language].said(sentence);

// Translates what the document says, once: texts, titles and labels of elements that are not filled by the page.
export function translatePage(root = document) {
  document.documentElement.lang = language;
  if (language === "en") return;
  const walker = document.createTreeWalker(root.body ?? root, NodeFilter.SHOW_TEXT);
  for (let node = walker.nextNode(); node; node = walker.nextNode()) {
    const words = node.nodeValue.trim();
    if (words) node.nodeValue = node.nodeValue.replace(words, t(words));
  }
  for (const name of ["title", "aria-label", "placeholder"]) {
    for (const node of (root.body ?? root).querySelectorAll(`[${name}]`)) node.setAttribute(name, t(node.getAttribute(name)));
  }
}
