"use strict";
// Everything shown comes from files of others: it enters the page as text (textContent), never as HTML.
const data = JSON.parse(document.getElementById("data").textContent);
const byId = (id) => document.getElementById(id);
const filters = ["method", "type", "home", "kind"];
let shown = [];
let at = 0;

function make(tag, text, className) {
  const element = document.createElement(tag);
  if (text !== undefined) element.textContent = text;
  if (className) element.className = className;
  return element;
}

const field = {
  method: (failure) => failure.method,
  type: (failure) => data.cases[failure.case].type,
  home: (failure) => data.cases[failure.case].home,
  kind: (failure) => failure.kind,
};
const metres = (value) => (value === null ? "–" : value.toFixed(2) + " m");
const methodTitle = (name) => data.methods[name];

function fillFilters() {
  for (const name of filters) {
    const counts = new Map();
    for (const failure of data.failures) counts.set(field[name](failure), (counts.get(field[name](failure)) || 0) + 1);
    const options = name === "method" ? Object.keys(data.methods).filter((m) => counts.has(m)) : [...counts.keys()].sort();
    const all = make("option", "all (" + data.failures.length + ")");
    all.value = "";
    byId(name).append(all);
    for (const value of options) {
      const words = name === "method" ? methodTitle(value) : value;
      const option = make("option", words + " (" + counts.get(value) + ")");
      option.value = value;
      byId(name).append(option);
    }
    byId(name).addEventListener("change", () => choose(0));
  }
}

function choose(index) {
  shown = [];
  data.failures.forEach((failure, number) => {
    if (filters.every((name) => byId(name).value === "" || byId(name).value === field[name](failure))) shown.push(number);
  });
  byId("list").replaceChildren(...shown.map((number, place) => {
    const failure = data.failures[number];
    const asked = data.cases[failure.case];
    const button = make("button", asked.target + " → " + (failure.object === null ? failure.status : failure.object));
    button.append(make("small", [methodTitle(failure.method), asked.type, asked.home].join(" · ")));
    button.addEventListener("click", () => show(place));
    return button;
  }));
  show(index);
}

function show(index) {
  at = Math.max(0, Math.min(index, shown.length - 1));
  byId("where").textContent = shown.length ? at + 1 + " of " + shown.length : "none";
  byId("back").disabled = at <= 0;
  byId("next").disabled = at >= shown.length - 1;
  const card = byId("card");
  if (!shown.length) {
    card.replaceChildren(make("p", data.failures.length ? "No failure fits these filters." : "No failure at all in this run."));
    return;
  }
  for (const button of byId("list").querySelectorAll("[aria-current]")) button.removeAttribute("aria-current");
  const button = byId("list").children[at];
  button.setAttribute("aria-current", "true");
  button.scrollIntoView({ block: "nearest" });
  const failure = data.failures[shown[at]];
  const asked = data.cases[failure.case];
  card.replaceChildren(make("blockquote", "“" + asked.text.trim() + "”"), photo(failure, asked), facts(failure, asked), others(failure, asked));
  card.scrollTop = 0;
  location.replace("#" + (shown[at] + 1));
}

function photo(failure, asked) {
  const figure = make("figure");
  if (failure.photo === null) {
    figure.append(make("p", failure.frame === null ? "no place, so no photo" : "no photo here (frame " + failure.frame + ")"));
    return figure;
  }
  const image = make("img");
  image.src = failure.photo;
  image.alt = "what the robot saw in frame " + failure.frame;
  figure.append(image, make("figcaption", "where it was sent: frame " + failure.frame + " of " + asked.home));
  return figure;
}

function facts(failure, asked) {
  const list = make("dl");
  const also = asked.accept.filter((name) => name !== asked.target);
  const lines = [
    ["wanted", asked.target + (also.length ? " (or " + also.join(", ") + ")" : ""), "right"],
    ["got", failure.object === null ? "nothing" : failure.object, failure.match ? "right" : "wrong"],
    ["distance", failure.distance === null ? "no place" : metres(failure.distance) + " (" + metres(failure.floor) + " on the floor plan)"],
    ["went wrong", failure.kind],
    ["method", methodTitle(failure.method)],
    ["status", failure.status],
    ["why", failure.note || "–"],
    ["goal", failure.reachable === null ? "not sought" : failure.reachable ? "reachable" : "not reachable"],
    ["position", failure.position === null ? "–" : failure.position.map((v) => v.toFixed(2)).join(", ") + " m"],
    ["request", asked.query + " (" + asked.type + ")"],
    ["home", asked.home],
  ];
  for (const [name, value, look] of lines) list.append(make("dt", name), make("dd", value, look));
  return list;
}

function others(failure, asked) {
  const table = make("table");
  table.append(make("caption", "the same request in this home, by every method"));
  const head = make("tr");
  for (const name of ["method", "got", "right object", "distance"]) head.append(make("th", name));
  table.append(head);
  for (const [method, object, match, distance, status] of asked.answers) {
    const row = make("tr");
    if (method === failure.method) row.setAttribute("aria-current", "true");
    row.append(make("td", methodTitle(method)), make("td", object === null ? status : object));
    row.append(make("td", match ? "yes" : "no", match ? "right" : "wrong"), make("td", metres(distance)));
    table.append(row);
  }
  return table;
}

document.addEventListener("keydown", (event) => {
  if (event.target.tagName === "SELECT" || event.altKey || event.ctrlKey || event.metaKey) return;
  const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
  if (step) {
    event.preventDefault();
    show(at + step);
  }
});
byId("back").addEventListener("click", () => show(at - 1));
byId("next").addEventListener("click", () => show(at + 1));
byId("made").textContent = data.made_by + data.left_out;
fillFilters();
choose((parseInt(location.hash.slice(1), 10) || 1) - 1);
