"use strict";
// Helpers shared by the page (app.js) and the answer in an MCP host (answer.js). Texts are inserted as text, never as HTML.

const COLOURS = new Map(Object.entries({ black: "#26262a", white: "#f4f4f0", grey: "#8d9096", red: "#c8403a", orange: "#d9823b", brown: "#8a5f3c", yellow: "#dcc04c", green: "#5b9a52", blue: "#4a78b8", purple: "#80609f", pink: "#d893ae", beige: "#d8c6a2", turquoise: "#4fa9a4" })), colourOf = (obj) => COLOURS.get(obj.colours[0]) || "#4a78b8"; // a colour's name comes from outside: no bare object
const called = (obj) => obj.names[0] || obj.label;
const calledAny = (objects, names) => objects.filter((t) => t.confirmed && (names.includes(t.label) || t.names.some((n) => names.includes(n))));
const footprint = (t) => Math.max(t.high[0] - t.low[0], 0.02) * Math.max(t.high[1] - t.low[1], 0.02);
// From the bottom to the top: tentative objects below confirmed ones, large ones below small ones, and what is on or in another above it.
function stacked(objects) {
  const sorted = [...objects].sort((a, b) => a.confirmed - b.confirmed || footprint(b) - footprint(a) || a.id - b.id), ids = new Map(objects.map((t) => [t.id, t])), order = new Set(), begun = new Set();
  const put = (t) => {
    if (begun.has(t.id)) return;
    begun.add(t.id);
    const under = t.on && ids.get(t.on[1]);
    if (under && under.confirmed === t.confirmed) put(under);
    order.add(t);
  };
  sorted.forEach(put);
  return [...order];
}
const el = (id) => document.getElementById(id);
const make = (name, attributes = {}, ...inside) => {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) { if (key.startsWith("on")) made.addEventListener(key.slice(2), value); else if (value !== null) made.setAttribute(key, value); }
  made.append(...inside.filter((i) => i !== null && i !== undefined));
  return made;
};
const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const button = (text, onclick, kind) => make("button", { type: "button", onclick, class: kind || null }, text);
function tip(obj, e) {
  const box = el("tip");
  box.hidden = !obj;
  if (!obj) return;
  box.textContent = `${called(obj)}${obj.names.length ? ` (${obj.label})` : ""} · ${obj.confirmed ? "" : "not sure, "}${Math.round(obj.probability * 100)} %`;
  const stage = el("stage").getBoundingClientRect();
  box.style.left = `${Math.min(e.clientX - stage.left + 14, stage.width - box.offsetWidth - 6)}px`;
  box.style.top = `${Math.max(e.clientY - stage.top - 34, 4)}px`;
}
function inWords(goal) {
  if (!goal) return "…";
  const told = goal.route && goal.route.directions.length ? ` ${goal.route.directions.join("; ")}.` : "";
  return goal.path ? `${goal.length_m.toFixed(1)} m to drive, to x ${goal.x.toFixed(2)} y ${goal.y.toFixed(2)}${goal.sees_it === false ? ", something in between" : ""}${told && `:${told}`}` : goal.why || "none";
}
function showPhoto(into, photo, obj) {
  if (!photo) return;
  const image = make("img", { src: photo.src, alt: `The photo that shows the ${called(obj)}, with its box` });
  image.addEventListener("load", () => {
    const [x1, y1, x2, y2] = photo.box, w = image.naturalWidth, h = image.naturalHeight, mark = make("i"), low = (v, m) => Math.max(0, v) / m * 100;
    Object.assign(mark.style, { left: `${low(x1, w)}%`, top: `${low(y1, h)}%`, width: `${(Math.min(x2, w) - Math.max(0, x1)) / w * 100}%`, height: `${(Math.min(y2, h) - Math.max(0, y1)) / h * 100}%` });
    into.append(mark);
    if (photo.src.startsWith("blob:")) URL.revokeObjectURL(photo.src);
  });
  into.replaceChildren(image);
  into.hidden = false;
}
function expand(runs, size) {
  const cells = new Int32Array(size);
  for (let i = 0, at = 0; i + 1 < runs.length; at += runs[i + 1], i += 2) cells.fill(runs[i], at, at + runs[i + 1]);
  return cells;
}
