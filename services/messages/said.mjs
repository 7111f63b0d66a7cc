// Sentences in the reader's language, for the rig's page and the class page: an English sentence is its own key, as with gettext.

export class Catalogue {
  // words: from English sentences to those of a language; what is missing stays English
  constructor(words = {}) {
    this.words = words;
    this.patterns = patternsOf(words);
  }

  // The sentence with the values of its {names}.
  t(sentence, values = {}) {
    return (this.words[sentence] ?? sentence).replace(/\{(\w+)\}/g, (all, name) => (name in values ? String(values[name]) : all));
  }

  // A sentence that the rig says: the key has {0}, {1} and so on where it puts values in, which may be sentences themselves.
  said(sentence = "") {
    if (!sentence || this.words[sentence]) return this.words[sentence] ?? "";
    for (const { pattern, words } of this.patterns) {
      const found = pattern.exec(sentence);
      if (found) return words.replace(/\{(\d+)\}/g, (_, i) => this.said(found[Number(i) + 1]));
    }
    return sentence;
  }
}

// Those that say most come first, and "{0}: {1}" is for what none of them fits.
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
