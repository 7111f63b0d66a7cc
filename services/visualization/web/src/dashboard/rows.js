// Rows that are made once and then only change their text: nothing jumps, and selections stay.

export class Rows {
  constructor(parent, make, update) {
    this.parent = parent;
    this.make = make;
    this.apply = update;
    this.rows = new Map();
  }

  update(items, key) {
    const seen = new Set();
    for (const item of items) {
      const name = key(item);
      seen.add(name);
      let row = this.rows.get(name);
      if (!row) {
        row = this.make(item);
        this.rows.set(name, row);
        this.parent.append(row);
      }
      this.apply(row, item);
    }
    for (const [name, row] of this.rows) {
      if (seen.has(name)) continue;
      row.remove();
      this.rows.delete(name);
    }
  }
}

export function element(tag, properties = {}, ...children) {
  const node = Object.assign(document.createElement(tag), properties);
  node.append(...children);
  return node;
}

export function text(node, value) {
  if (node.textContent !== value) node.textContent = value;
}

export function tableRow(cells) {
  return element("tr", {}, ...Array.from({ length: cells }, () => element("td")));
}
