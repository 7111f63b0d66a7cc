// For test_layout.py: an attempt as a rig would tell of one, and what a person would see of it.

globalThis.layout = {
  tell(state = "running") {
    document.getElementById("tools").innerHTML = ["left", "right"].map((side) => `<li data-side="${side}"><span>${side}</span>
      <b><i></i><u style="left: 90%"></u></b><output>123 mN</output><small>jaws 20°</small><em>holding the catheter</em></li>`).join("");
    const attempt = {
      attempt_id: "a", state, outcome: state === "done" ? "success" : "", score: state === "done" ? 413 : -1, reason: "", pace: 1, title: "Slide the catheter into the duct", scenario: "basic",
      time_s: 83.2, time_limit_s: 300, depth_m: 0.0071, goal_depth_m: 0.01, depth_max_m: 0.02, force_limit_n: 2.6,
      errors: { E3: 2, E10: 1 }, counts: false, why_not: "the rig was late", held: ["catheter", ""], phase: "P4", bookmarks_s: [],
      hint: "Lead the tip of the catheter into the mouth of the duct.",
    };
    trocar.attempt.update(attempt);
    trocar.instructor.update(attempt);
  },

  // In how many lines the words of an element are.
  lines(id) {
    const range = document.createRange();
    range.selectNodeContents(document.getElementById(id));
    return new Set([...range.getClientRects()].map((box) => Math.round(box.top))).size;
  },

  // How many boxes of words lie over others.
  overlaps() {
    const boxes = [...document.querySelectorAll("#attempt, #tools li")].map((node) => node.getBoundingClientRect()).filter((box) => box.width);
    const meet = (a, b) => a.left < b.right - 1 && b.left < a.right - 1 && a.top < b.bottom - 1 && b.top < a.bottom - 1;
    return boxes.flatMap((a, i) => boxes.slice(i + 1).filter((b) => meet(a, b))).length;
  },

  // Contrast of words against what is under them (WCAG 2), by the words; what lets the picture through is taken as it is.
  contrasts() {
    const words = "header button:not(:disabled), .badge, #attempt :is(b, output, p, small), #tools :is(span, em), #instructor :is(h2, p, li, td)";
    const nodes = [...document.querySelectorAll(words)].filter((node) => node.innerText?.trim() && node.getBoundingClientRect().width);
    return Object.fromEntries(nodes.map((node) => {
      const [dark, bright] = [light(rgb(getComputedStyle(node).color)), light(ground(node))].sort((a, b) => a - b);
      return [`${node.tagName} ${node.id} ${node.innerText.slice(0, 20)}`, (bright + 0.05) / (dark + 0.05)];
    }));
  },
};

const rgb = (text) => text.match(/[\d.]+/g).map(Number);

function light(colour) {
  const linear = colour.slice(0, 3).map((c) => c / 255).map((c) => (c <= 0.03928 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4));
  return linear.reduce((sum, c, i) => sum + c * [0.2126, 0.7152, 0.0722][i], 0);
}

function ground(node) {
  for (let at = node; at; at = at.parentElement) {
    const [r, g, b, opacity = 1] = rgb(getComputedStyle(at).backgroundColor);
    if (opacity > 0.6) return [r, g, b];
  }
  return [0, 0, 0];
}
