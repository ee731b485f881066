"use strict";
// Labels in pixels that overlap neither each other nor what they must not hide.

const pen = document.createElement("canvas").getContext("2d"), widths = new Map();
function wide(text, size, bold) {
  const key = `${size}|${bold}|${text}`;
  if (!widths.has(key)) { pen.font = `${bold ? 700 : 400} ${size}px ${getComputedStyle(document.body).fontFamily}`; widths.set(key, pen.measureText(text).width); }
  return widths.get(key);
}
const meet = (a, b) => a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3];

class Labels {
  constructor(width, height) { this.width = width; this.height = height; this.kept = []; this.placed = []; }
  keep(box, id = null) { this.kept.push({ box, id }); } // a box that no label may cover but the one of its object
  // `over` are further boxes that this one may not cover. Writes a text at the first of the spots [x, y] (its middle) that is free; `force` takes the first one that is in view.
  put(text, size, spots, { bold = false, id = null, force = false, kind = "", over = null } = {}) {
    const w = wide(text, size, bold) + 6, h = size * 1.3, inside = ([x, y]) => x >= w / 2 && x <= this.width - w / 2 && y >= h / 2 && y <= this.height - h / 2;
    const box = ([x, y]) => [x - w / 2, y - h / 2, x + w / 2, y + h / 2];
    const free = (spot) => { const mine = box(spot); return inside(spot) && !this.placed.some((p) => meet(p.box, mine)) && !this.kept.some((k) => (id === null || k.id !== id) && meet(k.box, mine)) && !(over || []).some((b) => meet(b, mine)); };
    let spot = spots.find(free);
    if (!spot && force && spots[0].every((v, i) => v > -w && v < [this.width, this.height][i] + w)) spot = [Math.min(Math.max(spots[0][0], w / 2), this.width - w / 2), Math.min(Math.max(spots[0][1], h / 2), this.height - h / 2)];
    if (spot) this.placed.push({ text, size, kind, id, x: spot[0], y: spot[1], box: box(spot) });
  }
  // Where a label of an object stands on or beside its box.
  static around([x0, y0, x1, y1], text, size, bold) {
    const w = wide(text, size, bold) / 2 + 4, h = size * 0.65, x = (x0 + x1) / 2, y = (y0 + y1) / 2, large = Math.sqrt((x1 - x0) * (y1 - y0)) > 16;
    const within = [[x, y], [x, y0 + h + 2], [x, y1 - h - 2], [x0 + w, y0 + h + 2], [x1 - w, y1 - h - 2]].filter(() => large), beside = [[x, y0 - h], [x, y1 + h], [x1 + w, y], [x0 - w, y]];
    return [...within, ...beside];
  }
  at(x, y) { const hit = this.placed.find(({ box, id }) => id !== null && x >= box[0] && x <= box[2] && y >= box[1] && y <= box[3]); return hit ? hit.id : null; }
}
