// What went wrong, as sentences for who did it. Codes are the engineer's.

import { said, t } from "./i18n.js";

// Of each error: what happened, what to do, and where in the picture: at the tip, at the mouth, or at a hand.
export const MISTAKES = {
  E1: { what: "You pulled too hard on the duct", how: "Hold it with less force: a bare duct tears easily.", at: "hand" },
  E2: { what: "You widened the opening", how: "Keep catheter and jaws off its rim.", at: "mouth" },
  E3: { what: "The tip missed the opening", how: "Look where the tip is, draw back, aim once.", at: "tip" },
  E4: { what: "You went through the wall", how: "Stop as soon as the tip meets resistance.", at: "tip" },
  E5: { what: "You pushed against resistance", how: "Do not push what does not advance: hold nearer to the mouth.", at: "tip" },
  E6: { what: "You stopped at a wrong depth", how: "End between the first and the second marker.", at: "tip" },
  E7: { what: "The catheter slipped out", how: "Keep hold of it until it is secured.", at: "tip" },
  E8: { what: "You crushed or kinked the catheter", how: "Close the jaws only so far that it does not slide.", at: "hand" },
  E9: { what: "The clip crimps, or is loose", how: "Close it until nothing leaks, and no further.", at: "mouth" },
  E10: { what: "Air went in, or something leaks", how: "Flush outside first, and secure before you flush.", at: "mouth" },
  E11: { what: "The tip points the wrong way", how: "Lead it along the duct, away from the gallbladder.", at: "tip" },
  E12: { what: "An instrument is out of view, or hits the other", how: "Keep both in the picture, and apart.", at: "hand" },
  E13: { what: "You dropped the catheter, or took it anew too often", how: "Take it where it can stay held.", at: "hand" },
  E14: { what: "Nobody steadies the duct", how: "Hold it with the other hand while the catheter goes in.", at: "mouth" },
};

export const what = (code) => t(MISTAKES[code]?.what ?? "Something went wrong");
export const how = (code) => t(MISTAKES[code]?.how ?? "");

const UNITS = { m: [1000, "mm"], "m/s": [1000, "mm/s"], N: [1, "N"], rad: [180 / Math.PI, "°"], s: [1, "s"], "": [1, ""] };

// A value in the unit that people read.
export function measured(value, unit) {
  const [factor, words] = UNITS[unit] ?? [1, unit];
  return `${(factor * value).toPrecision(2).replace(/\.0$/, "")} ${words}`.trim();
}

// What passes a task, and how far one is.
export const passesBy = ({ told }) => `${told.map(said).join(", ")}.`;

// What an error cost, in a sentence.
export function cost({ code, worst, limit, unit, points }) {
  const bounds = worst < limit ? " ({worst}, at least {limit})" : " ({worst}, at most {limit})";
  const by = unit === "" ? "" : t(bounds, { worst: measured(worst, unit), limit: measured(limit, unit) });
  const price = points >= 0.5 ? t("{points} points", { points: Math.round(points) }) : t("no points");
  return `${what(code)}${by}: ${price}.`;
}
