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
    this.svg = svg; this.on = on; this.shapes = new Map(); this.view = { x: 0, y: 0, w: 1, h: 1 }; this.chosen = null; this.only = null; this.placing = null; this.tentative = false; this.labels = new Labels(0, 0); this.camera = null;
    new ResizeObserver(() => this.data && this.resized()).observe(svg);
    svg.addEventListener("wheel", (e) => { e.preventDefault(); this.zoom(Math.exp(e.deltaY * 0.0015), this.metres(e)); }, { passive: false });
    svg.addEventListener("keydown", (e) => this.key(e));
    this.fingers = new Map();
    svg.addEventListener("pointerdown", (e) => { this.fingers.set(e.pointerId, e); this.moved = 0; this.touched = e; });
    window.addEventListener("pointermove", (e) => this.drag(e));
    for (const end of ["pointerup", "pointercancel"]) window.addEventListener(end, (e) => this.fingers.delete(e.pointerId));
    svg.addEventListener("click", (e) => {
      if (this.moved > 6) return;
      const at = e.pointerType === "touch" && this.touched ? this.touched : e; // browsers move a tap's click to what is small and near
      if (this.placing) { const [x, y] = this.metres(at); this.placing(x, -y); return; }
      this.on.choose(this.under(at));
    });
    svg.addEventListener("pointermove", (e) => { if (this.fingers.size) return; const obj = this.under(e); svg.classList.toggle("over", obj !== null); this.on.hover(obj, e); });
    svg.addEventListener("pointerleave", (e) => this.on.hover(null, e));
  }
  get px() { return this.view.w / (this.svg.getBoundingClientRect().width || 1); } // metres in a pixel
  seen(t) { return t.confirmed || this.tentative || t.id === this.chosen || (this.only !== null && this.only.has(t.id)); }
  box(t) { const x = (v) => (v - this.view.x) / this.px, y = (v) => (-v - this.view.y) / this.px; return [x(t.low[0]), y(t.high[1]), x(t.high[0]), y(t.low[1])]; } // in pixels
  // What a click means: a label's object, else the topmost box; a box too small for the pointer has some room around it, but only
  // above what it lies on. A tentative object is found only where there is no confirmed one.
  under(e) {
    if (!this.data) return null;
    const frame = this.svg.getBoundingClientRect(), x = e.clientX - frame.left, y = e.clientY - frame.top, named = this.labels.at(x, y), reach = e.pointerType === "touch" ? 10 : 6;
    if (named !== null) return this.byId.get(named);
    const seen = this.order.filter((t) => this.seen(t)).map((t, rank) => ({ t, rank, box: this.box(t) })).reverse();
    for (const sure of [true, false]) {
      const here = seen.filter(({ t }) => t.confirmed === sure), exact = here.find(({ box }) => x >= box[0] && x <= box[2] && y >= box[1] && y <= box[3]), side = ({ box }) => Math.max(box[2] - box[0], box[3] - box[1]);
      const off = ({ box }) => Math.hypot((box[0] + box[2]) / 2 - x, (box[1] + box[3]) / 2 - y), room = exact ? Math.min(reach, Math.min(exact.box[2] - exact.box[0], exact.box[3] - exact.box[1]) / 5) : reach;
      const near = here.filter((h) => side(h) < 2 * reach && off(h) <= room && (!exact || h.rank > exact.rank)).sort((a, b) => off(a) - off(b))[0];
      const hit = near && (!exact || side(exact) >= 2 * reach || off(near) < off(exact)) ? near : exact;
      if (hit) return hit.t;
    }
    return null;
  }
  metres(e) {
    const frame = this.svg.getBoundingClientRect();
    return [this.view.x + (e.clientX - frame.left) * this.px, this.view.y + (e.clientY - frame.top) * this.px];
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
    const w = Math.min(Math.max(this.view.w * by, 1), this.fitted * 3), k = w / this.view.w;
    this.look(at[0] - (at[0] - this.view.x) * k, at[1] - (at[1] - this.view.y) * k, w, this.view.h * k);
  }
  look(x, y, w, h) { this.view = { x, y, w, h }; this.svg.setAttribute("viewBox", `${x} ${y} ${w} ${h}`); this.name(); if (this.camera) this.robot(this.camera); if (this.on.scaled) this.on.scaled(1 / this.px); }
  fit() { // the whole home, as large as the canvas allows
    const frame = this.svg.getBoundingClientRect(), { x, y, w, h } = this.whole, gap = 2 * Math.min(16, 0.04 * frame.width);
    if (!frame.width || !frame.height) { this.look(x, y, w, h); this.fitted = w; return; }
    const px = Math.max(w / Math.max(frame.width - gap, 1), h / Math.max(frame.height - gap, 1));
    this.look(x + w / 2 - px * frame.width / 2, y + h / 2 - px * frame.height / 2, px * frame.width, px * frame.height);
    this.fitted = this.view.w;
  }
  resized() { // what somebody zoomed to stays, as wide as it was
    const zoomed = this.view.w !== this.fitted ? this.view : null, frame = this.svg.getBoundingClientRect();
    this.fit();
    if (zoomed && frame.width) this.look(zoomed.x, zoomed.y, zoomed.w, zoomed.w * frame.height / frame.width);
  }

  draw(data, css, stay) { // stay: keep the place and the size, if somebody chose them
    const zoomed = stay && this.data && this.view.w !== this.fitted ? this.view : null;
    this.data = data; this.byId = new Map(data.objects.map((t) => [t.id, t])); this.shapes.clear(); this.order = stacked(data.objects); this.goal = null;
    const [left, right, low, high] = data.extent;
    this.whole = { x: left, y: -high, w: Math.max(right - left, 0.5), h: Math.max(high - low, 0.5) };
    const group = shape("g", { "aria-hidden": "true" });
    if (data.grid) group.append(this.ground(data, css));
    for (const obj of this.order) {
      const size = [0, 1].map((i) => Math.max(obj.high[i] - obj.low[i], 0.04)), look = { x: obj.low[0], y: -obj.high[1], width: size[0], height: size[1], rx: Math.min(0.03, size[0] / 4, size[1] / 4) };
      const r = shape("rect", { ...look, class: obj.confirmed ? "object" : "object tentative", fill: colourOf(obj) });
      r.dataset.id = obj.id;
      this.shapes.set(obj.id, r);
      group.append(r);
    }
    this.start = shape("circle", { class: "start-mark", cx: data.start[0], cy: -data.start[1], r: 0.07 });
    this.way = shape("g"); this.frame = shape("g"); this.texts = shape("g"); this.here = shape("g");
    group.append(this.start, this.way, this.frame, this.here, this.texts);
    this.svg.replaceChildren(group);
    this.mark(this.chosen, this.only);
    this.fit();
    if (zoomed) this.look(zoomed.x, zoomed.y, zoomed.w, zoomed.h);
    this.robot(this.camera);
  }
  robot(camera) { // where a camera is that maps now: x, y (m), yaw (rad)
    this.camera = camera;
    if (!this.data) return;
    const [x, y, yaw] = camera || [], r = 26 * this.px, at = (a) => `${x + r * Math.cos(yaw + a)},${-(y + r * Math.sin(yaw + a))}`;
    this.here.replaceChildren(...(camera ? [shape("polygon", { class: "sight", points: [`${x},${-y}`, at(0.6), at(-0.6)].join(" ") }), shape("circle", { class: "robot-mark", cx: x, cy: -y, r: 7 * this.px })] : []));
  }
  ground(data, css) {
    const { rows, cols, side, origin, cells: runs } = data.grid, cells = expand(runs, rows * cols), heights = expand(data.grid.heights, rows * cols), canvas = document.createElement("canvas");
    canvas.width = cols; canvas.height = rows;
    const context = canvas.getContext("2d"), image = context.createImageData(cols, rows), rgb = (name) => css(name).match(/\w\w/g).map((h) => parseInt(h, 16));
    const base = [rgb("--unknown"), rgb("--floor"), rgb("--wall")], low = rgb("--low"); // walls are dark, furniture is light
    const tints = [[77, 148, 204], [224, 158, 70], [96, 168, 92], [168, 110, 190], [190, 172, 60], [214, 106, 120], [70, 170, 170], [130, 130, 150]];
    for (let i = 0; i < cells.length; i++) {
      const kind = cells[i] % 3, room = Math.floor(cells[i] / 3), row = Math.floor(i / cols), col = i % cols, at = ((rows - 1 - row) * cols + col) * 4;
      const wall = kind === 2 && heights[i] * data.grid.step > WALL_M, tint = room && !wall ? tints[(room - 1) % tints.length] : null, mix = 0.16, from = kind === 2 && !wall ? low : room && kind === 0 ? base[1] : base[kind];
      for (let c = 0; c < 3; c++) image.data[at + c] = tint ? from[c] * (1 - mix) + tint[c] * mix : from[c];
      image.data[at + 3] = 255;
    }
    context.putImageData(image, 0, 0);
    return shape("image", { x: origin[0], y: -(origin[1] + rows * side), width: cols * side, height: rows * side, href: canvas.toDataURL(), preserveAspectRatio: "none", class: "ground" });
  }
  // The chosen object is named first, then the rooms, then objects with names of their own, then large ones.
  name() {
    const frame = this.svg.getBoundingClientRect(), px = this.px, made = [];
    this.labels = new Labels(frame.width, frame.height);
    if (!frame.width) return;
    const at = (x, y) => [(x - this.view.x) / px, (-y - this.view.y) / px], spot = ([x, y], r) => [x - r, y - r, x + r, y + r];
    const shown = this.order.filter((t) => this.seen(t) && !this.dim(t)).map((t) => ({ t, box: this.box(t), text: `${called(t)}${t.confirmed ? "" : " ?"}` }));
    for (const { t, box } of shown) if (t.confirmed && Math.max(box[2] - box[0], box[3] - box[1]) < 40) this.labels.keep(box, t.id);
    const sure = shown.filter(({ t }) => t.confirmed).map(({ box }) => box);
    this.labels.keep(spot(at(...this.data.start), 7));
    this.start.setAttribute("r", 6 * px);
    if (this.goal) for (const [k, [x, y]] of this.goal.path.entries()) {
      const [[x0, y0], [x1, y1]] = [at(...this.goal.path[Math.max(k - 1, 0)]), at(x, y)], n = Math.ceil(Math.hypot(x1 - x0, y1 - y0) / 8);
      for (let j = 0; j <= n; j++) this.labels.keep(spot([x0 + (x1 - x0) * j / (n || 1), y0 + (y1 - y0) * j / (n || 1)], k + 1 === this.goal.path.length && j === n ? 12 : 4));
    }
    const rank = ({ t, box }) => (t.names.length ? 1e9 : 0) + (box[2] - box[0]) * (box[3] - box[1]) - (t.confirmed ? 0 : 1e6), large = ({ t, box }) => t.names.length || Math.sqrt((box[2] - box[0]) * (box[3] - box[1])) > 11;
    const name = ({ t, box, text }, size, more) => this.labels.put(text, size, Labels.around(box, text, size, Boolean(more.bold)), { id: t.id, over: t.confirmed ? null : sure, ...more });
    for (const s of shown) if (s.t.id === this.chosen) name(s, 13, { bold: true, force: true, kind: "named" });
    const steps = [0, -1, 1, -2, 2, -3, 3].flatMap((v) => [0, -1, 1].map((u) => [u, v]));
    for (const r of this.data.rooms) { const [x, y] = at(...r.at); this.labels.put(r.name, 14, steps.map(([u, v]) => [x + 40 * u, y + 18 * v]), { bold: true, kind: "room" }); }
    for (const s of shown.sort((a, b) => rank(b) - rank(a))) if (s.t.id !== this.chosen && large(s)) name(s, 11, { kind: s.t.confirmed ? "" : "unsure" });
    if (!this.goal) { const [x, y] = at(...this.data.start); this.labels.put("start", 11, [[x, y + 15], [x, y - 15], [x + 26, y], [x - 26, y]], { kind: "start" }); }
    for (const { text, size, kind, x, y } of this.labels.placed) made.push(shape("text", { x: this.view.x + x * px, y: this.view.y + (y + size * 0.35) * px, "font-size": size * px, "stroke-width": 3 * px, class: kind }, text));
    this.texts.replaceChildren(...made);
  }
  dim(t) { return this.only !== null && !this.only.has(t.id) && t.id !== this.chosen; }
  mark(chosen, only) {
    this.chosen = chosen; this.only = only;
    for (const [id, r] of this.shapes) { const t = this.byId.get(id); r.classList.toggle("chosen", id === chosen); r.classList.toggle("dim", this.dim(t)); r.toggleAttribute("hidden", !this.seen(t)); }
    const mark = this.shapes.get(chosen);
    this.frame.replaceChildren(...(mark ? [mark.cloneNode()] : [])); // its outline is above all, itself stays where it is
    for (const r of this.frame.children) { delete r.dataset.id; r.setAttribute("class", "outline"); }
    this.name();
  }
  walk(goal) {
    this.goal = goal && goal.path ? goal : null;
    this.way.replaceChildren();
    if (this.goal) {
      const points = (path) => path.map(([x, y]) => `${x},${-y}`).join(" ");
      if (goal.route) this.way.append(shape("polyline", { class: "way shortest", points: points(goal.route.shortest_path) })); // what it would be without rules
      this.way.append(shape("polyline", { class: "way", points: points(goal.path) }));
      const tip = (a, r) => `${goal.x + r * Math.cos(goal.yaw + a)},${-(goal.y + r * Math.sin(goal.yaw + a))}`;
      this.way.append(shape("polygon", { class: "robot-mark", points: [tip(0, 0.3), tip(2.5, 0.22), tip(Math.PI, 0.1), tip(-2.5, 0.22)].join(" ") }));
    }
    this.name();
  }
}
