"use strict";
// The floor plan as SVG, in metres: x to the right, y upwards.

const WALL_M = 1.5; // occupied cells higher than this are drawn as walls
const SVG = "http://www.w3.org/2000/svg";
const shape = (name, attributes = {}, text) => {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text !== undefined) made.textContent = text;
  return made;
};

class Plan {
  constructor(svg, on) {
    this.svg = svg; this.on = on; this.shapes = new Map(); this.view = { x: 0, y: 0, w: 1, h: 1 }; this.chosen = null; this.placing = null;
    new ResizeObserver(() => this.data && this.fit()).observe(svg);
    svg.addEventListener("wheel", (e) => { e.preventDefault(); this.zoom(Math.exp(e.deltaY * 0.0015), this.metres(e)); }, { passive: false });
    svg.addEventListener("keydown", (e) => this.key(e));
    this.fingers = new Map();
    svg.addEventListener("pointerdown", (e) => { this.fingers.set(e.pointerId, e); this.moved = 0; });
    window.addEventListener("pointermove", (e) => this.drag(e));
    for (const end of ["pointerup", "pointercancel"]) window.addEventListener(end, (e) => this.fingers.delete(e.pointerId));
    svg.addEventListener("click", (e) => {
      if (this.moved > 6) return;
      if (this.placing) { const [x, y] = this.metres(e); this.placing(x, -y); return; }
      this.on.choose(this.under(e));
    });
    svg.addEventListener("pointermove", (e) => { if (!this.fingers.size) this.on.hover(this.under(e), e); });
    svg.addEventListener("pointerleave", (e) => this.on.hover(null, e));
  }
  under(e) { const id = e.target.dataset && e.target.dataset.id; return id === undefined ? null : this.byId.get(Number(id)) || null; }
  metres(e) {
    const box = this.svg.getBoundingClientRect(), s = Math.min(box.width / this.view.w, box.height / this.view.h);
    return [this.view.x + this.view.w / 2 + (e.clientX - box.left - box.width / 2) / s, this.view.y + this.view.h / 2 + (e.clientY - box.top - box.height / 2) / s];
  }
  drag(e) {
    const before = this.fingers.get(e.pointerId);
    if (!before) return;
    this.moved += Math.abs(e.clientX - before.clientX) + Math.abs(e.clientY - before.clientY);
    if (this.fingers.size === 2) {
      const other = [...this.fingers.values()].find((f) => f.pointerId !== e.pointerId), gap = (f) => Math.hypot(f.clientX - other.clientX, f.clientY - other.clientY) || 1;
      this.zoom(gap(before) / gap(e), this.metres(e));
    } else if (this.moved > 6) {
      const [x0, y0] = this.metres(before), [x1, y1] = this.metres(e);
      this.look(this.view.x + x0 - x1, this.view.y + y0 - y1, this.view.w, this.view.h);
    }
    this.fingers.set(e.pointerId, e);
  }
  key(e) {
    const step = this.view.w / 10, to = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step] }[e.key];
    if (to) this.look(this.view.x + to[0], this.view.y + to[1], this.view.w, this.view.h);
    else if (e.key === "+" || e.key === "=") this.zoom(0.8);
    else if (e.key === "-") this.zoom(1.25);
    else if (e.key === "0") this.fit();
    else return;
    e.preventDefault();
  }
  zoom(by, at = [this.view.x + this.view.w / 2, this.view.y + this.view.h / 2]) {
    const w = Math.min(Math.max(this.view.w * by, 1), this.whole.w * 3), k = w / this.view.w;
    this.look(at[0] - (at[0] - this.view.x) * k, at[1] - (at[1] - this.view.y) * k, w, this.view.h * k);
  }
  look(x, y, w, h) { this.view = { x, y, w, h }; this.svg.setAttribute("viewBox", `${x} ${y} ${w} ${h}`); this.name(); }
  fit() { const { x, y, w, h } = this.whole; this.look(x, y, w, h); }

  draw(data, css) {
    this.data = data; this.byId = new Map(data.objects.map((t) => [t.id, t])); this.shapes.clear();
    const all = data.objects.flatMap((t) => [t.low, t.high]).concat([[...data.start, 0]]);
    let [x0, y0, x1, y1] = [Math.min(...all.map((p) => p[0])), Math.min(...all.map((p) => p[1])), Math.max(...all.map((p) => p[0])), Math.max(...all.map((p) => p[1]))];
    const ground = data.grid ? this.ground(data, css) : null;
    if (ground) [x0, y0, x1, y1] = ground.known;
    const pad = 0.35;
    this.whole = { x: x0 - pad, y: -y1 - pad, w: x1 - x0 + 2 * pad, h: y1 - y0 + 2 * pad };
    const group = shape("g", { "aria-hidden": "true" });
    if (ground) group.append(ground.image);
    for (const obj of [...data.objects].sort((a, b) => a.high[2] - b.high[2])) {
      const r = shape("rect", { x: obj.low[0], y: -obj.high[1], width: Math.max(obj.high[0] - obj.low[0], 0.04), height: Math.max(obj.high[1] - obj.low[1], 0.04), rx: 0.03, class: obj.confirmed ? "object" : "object tentative", fill: COLOURS[obj.colours[0]] || "#4a78b8" });
      r.dataset.id = obj.id;
      this.shapes.set(obj.id, r);
      group.append(r);
    }
    this.way = shape("g"); this.texts = shape("g");
    group.append(this.way, this.texts);
    this.svg.replaceChildren(group);
    this.fit();
  }
  ground(data, css) {
    const { rows, cols, side, origin, cells: runs } = data.grid, cells = expand(runs, rows * cols), heights = expand(data.grid.heights, rows * cols), canvas = document.createElement("canvas");
    canvas.width = cols; canvas.height = rows;
    const context = canvas.getContext("2d"), image = context.createImageData(cols, rows), rgb = (name) => css(name).match(/\w\w/g).map((h) => parseInt(h, 16));
    const base = [rgb("--unknown"), rgb("--floor"), rgb("--wall")], low = rgb("--low"); // walls are dark, furniture is light
    const tints = [[77, 148, 204], [224, 158, 70], [96, 168, 92], [168, 110, 190], [190, 172, 60], [214, 106, 120], [70, 170, 170], [130, 130, 150]];
    let [x0, y0, x1, y1] = [cols, rows, 0, 0];
    for (let i = 0; i < cells.length; i++) {
      const kind = cells[i] % 3, room = Math.floor(cells[i] / 3), row = Math.floor(i / cols), col = i % cols, at = ((rows - 1 - row) * cols + col) * 4;
      const wall = kind === 2 && heights[i] * data.grid.step > WALL_M, tint = room && !wall ? tints[(room - 1) % tints.length] : null, mix = 0.16, from = kind === 2 && !wall ? low : room && kind === 0 ? base[1] : base[kind];
      for (let c = 0; c < 3; c++) image.data[at + c] = tint ? from[c] * (1 - mix) + tint[c] * mix : from[c];
      image.data[at + 3] = 255;
      if (kind) { x0 = Math.min(x0, col); x1 = Math.max(x1, col + 1); y0 = Math.min(y0, row); y1 = Math.max(y1, row + 1); }
    }
    context.putImageData(image, 0, 0);
    const drawn = shape("image", { x: origin[0], y: -(origin[1] + rows * side), width: cols * side, height: rows * side, href: canvas.toDataURL(), preserveAspectRatio: "none", class: "ground" });
    return { image: drawn, known: [origin[0] + x0 * side, origin[1] + y0 * side, origin[0] + x1 * side, origin[1] + y1 * side] };
  }
  // Labels must not overlap: the chosen object comes first, then rooms, then named objects, then large ones.
  name() {
    const box = this.svg.getBoundingClientRect(), px = Math.max(this.view.w / (box.width || 1), this.view.h / (box.height || 1)), taken = [];
    const put = (text, x, y, size, kind, force) => {
      const w = text.length * size * 0.56 * px, h = size * 1.25 * px, mine = [x - w / 2, y - h / 2, x + w / 2, y + h / 2];
      if (!force && taken.some((t) => t[0] < mine[2] && mine[0] < t[2] && t[1] < mine[3] && mine[1] < t[3])) return;
      taken.push(mine);
      made.push(shape("text", { x, y: y + size * 0.35 * px, "font-size": size * px, "stroke-width": 3 * px, class: kind }, text));
    };
    const made = [], area = (t) => (t.high[0] - t.low[0]) * (t.high[1] - t.low[1]);
    const shown = this.data.objects.filter((t) => this.shapes.has(t.id) && (t.confirmed || t.id === this.chosen) && !this.shapes.get(t.id).classList.contains("dim"));
    const rank = (t) => (t.id === this.chosen ? 1e6 : t.names.length ? 1e3 : area(t));
    for (const t of shown.filter((t) => t.id === this.chosen)) put(called(t), t.at[0], -t.at[1], 13, "named", true);
    for (const r of this.data.rooms) put(r.name, r.at[0], -r.at[1], 14, "room");
    for (const t of shown.sort((a, b) => rank(b) - rank(a))) if (t.id !== this.chosen && (t.names.length || Math.sqrt(area(t)) / px > 16)) put(called(t), t.at[0], -t.at[1], 11, "");
    this.texts.replaceChildren(...made);
  }
  mark(chosen, only) {
    this.chosen = chosen;
    for (const [id, r] of this.shapes) { r.classList.toggle("chosen", id === chosen); r.classList.toggle("dim", only !== null && !only.has(id) && id !== chosen); }
    if (chosen !== null && this.shapes.has(chosen)) this.way.before(this.shapes.get(chosen));
    this.name();
  }
  walk(goal) {
    this.way.replaceChildren();
    if (!goal || !goal.path) return;
    this.way.append(shape("polyline", { class: "way", points: goal.path.map(([x, y]) => `${x},${-y}`).join(" ") }), shape("circle", { class: "robot-mark", cx: goal.path[0][0], cy: -goal.path[0][1], r: 0.07 }));
    const tip = (a, r) => `${goal.x + r * Math.cos(goal.yaw + a)},${-(goal.y + r * Math.sin(goal.yaw + a))}`;
    this.way.append(shape("polygon", { class: "robot-mark", points: [tip(0, 0.3), tip(2.5, 0.22), tip(Math.PI, 0.1), tip(-2.5, 0.22)].join(" ") }));
  }
}
