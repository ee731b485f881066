"use strict";
// The page: a conversation and a list beside the plan; what is chosen in one is chosen in all. Texts are only ever set as text.

const stored = el("home-data"), source = stored ? new Stored(JSON.parse(stored.textContent)) : new Served();
let data = null, chosen = null, offered = null, busy = false;
const on = { choose: (t) => choose(t ? t.id : null), hover: tip };
const plan = new Plan(el("plan"), on), scene = new Scene(el("scene"), on), views = [plan, scene];
const byId = (id) => data.objects.find((t) => t.id === id);
const roomOf = (thing) => data.rooms.find((r) => r.id === thing.room);

function toast(text) {
  const box = el("toast");
  box.textContent = text; box.hidden = false;
  clearTimeout(toast.timer);
  toast.timer = setTimeout(() => { box.hidden = true; }, 6000);
}
async function safely(work) {
  try { return await work(); } catch (error) { toast(error.message); return null; }
}

function choose(id, goal) {
  chosen = id;
  stopPlacing();
  const only = offered && (id === null || offered.has(id)) ? offered : null;
  for (const v of views) { v.mark(id, only); v.walk(goal || null); }
  for (const b of el("list").querySelectorAll("button")) b.setAttribute("aria-current", String(Number(b.dataset.id) === id));
  showCard(goal);
  if (id !== null && goal === undefined) safely(async () => { const found = await source.goal(byId(id)); if (chosen === id) { for (const v of views) v.walk(found); el("way").textContent = inWords(found); } });
}

function showCard(goal) {
  const card = el("card"), thing = chosen === null ? null : byId(chosen);
  card.hidden = !thing;
  if (!thing) { card.replaceChildren(); return; }
  const size = thing.high.map((h, i) => Math.round((h - thing.low[i]) * 100)).join(" × "), room = roomOf(thing), on = thing.on && byId(thing.on[1]);
  const facts = [["Sure", `${Math.round(thing.sure * 100)} %, seen in ${thing.seen} of ${thing.of} frames`], ["Where", room ? room.name : `x ${thing.at[0].toFixed(2)} y ${thing.at[1].toFixed(2)}`], on ? ["Stands", `${thing.on[0]} ${called(on)}`] : null, ["Size", `${size} cm`], thing.colours.length ? ["Colour", thing.colours.join(", ")] : null, thing.names.length || thing.also.length ? ["Also", [...(thing.names.length ? [thing.label] : []), ...thing.also].join(", ")] : null].filter(Boolean);
  const way = make("dd", { id: "way" }, inWords(goal));
  const dl = make("dl", {}, ...facts.flatMap(([k, v]) => [make("dt", {}, k), make("dd", {}, v)]), make("dt", {}, "Way"), way);
  const photo = make("span", { class: "photo", hidden: "" }), doing = make("div", { class: "doing" });
  const idle = () => doing.replaceChildren(button("Rename", () => rename(thing, doing, idle)), button("Move", () => move(thing, doing, idle)), button("Forget", () => correct("forget", thing, {})));
  if (source.canCorrect) idle();
  card.replaceChildren(make("div", { class: "top" }, make("h2", {}, called(thing), make("span", { class: "muted" }, ` ${thing.id}`)), make("button", { type: "button", "aria-label": "Close", onclick: () => { choose(null); el("words").focus(); } }, "×")), photo, dl, doing);
  if (thing.views) safely(async () => showPhoto(photo, await source.photo(thing, 1), thing));
}
function form(doing, idle, fields, send) {
  const made = make("form", { class: "doing", onsubmit: (e) => { e.preventDefault(); send(); } }, ...fields, make("button", { class: "main" }, "Save"), button("Cancel", () => { stopPlacing(); idle(); }));
  doing.replaceChildren(made);
  fields[0].focus();
}
function rename(thing, doing, idle) {
  const name = make("input", { "aria-label": "New name", placeholder: "What do you call it?", maxlength: "60", value: thing.names[0] || "" });
  form(doing, idle, [name], () => correct("name", thing, { name: name.value }));
}
function move(thing, doing, idle) {
  const [x, y] = [0, 1].map((k) => make("input", { type: "number", step: "0.01", "aria-label": `${"xy"[k]} in metres`, value: thing.at[k].toFixed(2) }));
  form(doing, idle, [x, y], () => correct("move", thing, { x: Number(x.value), y: Number(y.value) }));
  if (el("plan").hasAttribute("hidden")) return;
  el("hint").textContent = "Click where it stands now"; el("hint").hidden = false; el("plan").classList.add("placing");
  plan.placing = (px, py) => { x.value = px.toFixed(2); y.value = py.toFixed(2); correct("move", thing, { x: px, y: py }); };
}
function stopPlacing() { plan.placing = null; el("hint").hidden = true; el("plan").classList.remove("placing"); }
function correct(what, thing, more) {
  return safely(async () => {
    const told = await source.correct(what, thing.id, more);
    stopPlacing();
    await reload(what === "forget" ? null : thing.id);
    toast(`${told.done}. Undo takes it back.`);
    (what === "forget" ? el("undo") : document.querySelector("#card .doing button")).focus(); // the form that had the focus is gone
  });
}

function say(kind, ...inside) {
  const li = make("li", { class: kind }, ...inside);
  el("turns").append(li);
  li.scrollIntoView({ block: "nearest" });
  return li;
}
async function ask(words) {
  if (!words.trim() || busy) return;
  busy = true;
  say("person", words);
  const waiting = say("robot", "…");
  try { answer(waiting, await source.ask(words)); } catch (error) { waiting.replaceChildren(make("p", {}, error.message)); }
  busy = false;
  waiting.scrollIntoView({ block: "nearest" });
}
function answer(into, told) {
  const parts = [], goalText = told.goal ? make("small", {}, inWords(told.goal)) : null;
  const head = told.text || (told.object ? `${told.status === "likely_near" ? "Likely near the " : ""}${told.name || told.object}${told.room ? `, in the ${told.room}` : ""}.` : told.question || "Nothing here serves that.");
  parts.push(make("p", {}, head[0].toUpperCase() + head.slice(1)), told.reason ? make("small", {}, told.reason) : null, goalText, ...(told.notes || []).map((n) => make("small", {}, n)));
  const ids = (told.ids || []).map(byId).filter(Boolean), names = told.status === "clarify" ? (told.candidates || []).map(([n]) => n) : [];
  const options = ids.length ? ids : data.objects.filter((t) => t.confirmed && (names.includes(t.label) || t.names.some((n) => names.includes(n))));
  offered = options.length ? new Set(options.map((t) => t.id)) : null;
  if (options.length) parts.push(make("div", { class: "choices" }, ...options.slice(0, 12).map((t) => { const b = button(apart(t, options), () => choose(t.id)); b.prepend(dot(t)); return b; })));
  into.replaceChildren(...parts.filter(Boolean));
  if (told.id !== undefined) choose(told.id, told.goal || undefined); else choose(null);
  for (const further of told.next || []) answer(say("robot", ""), further);
  if (el("mic").dataset.used) speechSynthesis.speak(new SpeechSynthesisUtterance(head));
}
function apart(thing, others) { // its name, and what tells it from those of the same name
  const same = others.filter((o) => called(o) === called(thing)), room = roomOf(thing), tells = (of) => new Set(same.map(of)).size === same.length;
  const colour = (t) => t.colours[0] || "", place = (t) => (roomOf(t) || { name: "" }).name;
  if (same.length === 1) return `${called(thing)}${room && data.rooms.length > 1 ? ` · ${room.name}` : ""}`;
  return `${called(thing)} · ${tells(place) ? place(thing) : tells(colour) ? colour(thing) : `${place(thing)} (${thing.id})`}`;
}
function dot(thing) {
  const made = make("span", { class: "dot", "aria-hidden": "true" });
  made.style.background = COLOURS[thing.colours[0]] || "#4a78b8";
  return made;
}

function listThings() {
  const wanted = plain(el("search").value), room = el("room").value, unsure = el("unsure").checked;
  const fits = (t) => (t.confirmed || unsure) && (room === "" || String(t.room) === room) && (!wanted || plain([...t.names, t.label, ...t.also, ...t.colours, (roomOf(t) || { name: "" }).name].join(" ")).includes(wanted));
  const found = data.objects.filter(fits), rows = [], places = [...data.rooms, { id: null, name: data.rooms.length ? "elsewhere" : "objects" }];
  for (const place of places) {
    const here = found.filter((t) => t.room === place.id || (place.id === null && !roomOf(t))).sort((a, b) => called(a).localeCompare(called(b)) || a.id - b.id);
    if (!here.length) continue;
    rows.push(make("li", {}, make("h2", {}, `${place.name}${place.area ? `, ${place.area} m²` : ""} `, source.canCorrect && place.id !== null ? make("button", { type: "button", class: "pen", "aria-label": `Rename ${place.name}`, onclick: () => renameRoom(place) }, "✎︎") : null)));
    for (const t of here) {
      const row = make("button", { type: "button", "aria-current": String(t.id === chosen), onclick: () => choose(t.id) }, dot(t), `${called(t)}${t.confirmed ? "" : " ?"}`, make("span", { class: "muted" }, `${Math.round(t.sure * 100)} %`));
      row.dataset.id = t.id;
      rows.push(make("li", {}, row));
    }
  }
  el("list").replaceChildren(...(rows.length ? rows : [make("li", { class: "muted" }, "Nothing here has that name.")]));
  el("count").textContent = String(data.objects.filter((t) => t.confirmed).length);
  offered = wanted || room !== "" ? new Set(found.map((t) => t.id)) : null;
  for (const v of views) v.mark(chosen, offered);
}
function renameRoom(place) {
  const name = make("input", { "aria-label": `New name of ${place.name}`, maxlength: "60", value: place.name }), row = [...el("list").querySelectorAll("h2")].find((h) => h.textContent.startsWith(place.name));
  row.replaceChildren(make("form", { class: "doing", onsubmit: (e) => { e.preventDefault(); safely(async () => { const told = await source.correct("name", `room:${place.id}`, { name: name.value }); await reload(chosen); toast(`${told.done}. Undo takes it back.`); }); } }, name, make("button", { class: "main" }, "Save"), button("Cancel", listThings)));
  name.focus(); name.select();
}

async function reload(keep) {
  data = await source.view();
  document.title = `${data.title} · cartier`;
  el("title").textContent = data.title;
  const sure = data.objects.filter((t) => t.confirmed).length, age = data.age_h === undefined ? "" : data.age_h < 1 ? ", mapped within the hour" : data.age_h < 48 ? `, mapped ${Math.round(data.age_h)} h ago` : `, mapped ${Math.round(data.age_h / 24)} days ago`;
  el("about").textContent = `${sure} objects${data.rooms.length ? `, ${data.rooms.length} room${data.rooms.length > 1 ? "s" : ""}` : ""}${age}`;
  el("about").title = [data.detector, ...data.notes].join("\n");
  el("undo").hidden = !source.canCorrect || !data.corrections;
  const room = el("room").value;
  el("room").replaceChildren(make("option", { value: "" }, "all rooms"), ...data.rooms.map((r) => make("option", { value: String(r.id) }, r.name)));
  el("room").value = room;
  plan.draw(data, css); scene.draw(data, css, plan.whole);
  loadPoints();
  listThings();
  choose(keep !== undefined && keep !== null && byId(keep) ? keep : null);
}
function tab(which) {
  for (const name of ["talk", "things"]) { el(name).hidden = name !== which; el(`tab-${name}`).setAttribute("aria-selected", String(name === which)); el(`tab-${name}`).tabIndex = name === which ? 0 : -1; }
}
function show(solid) {
  if (solid) { el("scene").hidden = false; if (!scene.start()) { el("scene").hidden = true; toast("This browser draws no WebGL2."); return; } }
  el("plan").toggleAttribute("hidden", solid); el("scene").hidden = !solid;
  el("flat").setAttribute("aria-pressed", String(!solid)); el("solid").setAttribute("aria-pressed", String(solid));
  stopPlacing();
  el("points-on").hidden = !solid || !scene.cloud;
  if (solid) { scene.paint(); loadPoints(); } else plan.name();
}
function loadPoints() { // when somebody looks at them, and not before
  const of = `${source.home}@${data.home_id}`;
  if (el("scene").hidden || loadPoints.of === of) return;
  loadPoints.of = of;
  scene.load(null);
  safely(async () => {
    const cloud = await source.cloud();
    if (loadPoints.of !== of) return;
    scene.load(cloud);
    el("points-on").hidden = el("scene").hidden || !cloud;
  });
}
function theme(dark) {
  document.documentElement.classList.toggle("dark", dark);
  if (data) { plan.draw(data, css); scene.paint(); choose(chosen); }
}
function listen() { // the browser's own speech, where it has one
  const Heard = window.SpeechRecognition || window.webkitSpeechRecognition;
  if (!Heard || !window.speechSynthesis || stored) return;
  el("mic").hidden = false;
  el("mic").addEventListener("click", () => {
    const ear = new Heard();
    el("mic").dataset.used = "1";
    ear.lang = navigator.language;
    ear.onresult = (e) => ask(e.results[0][0].transcript);
    ear.onerror = (e) => toast(`The browser heard nothing (${e.error}).`);
    ear.start();
  });
}

const current = () => (el("scene").hidden ? plan : scene);
el("ask").addEventListener("submit", (e) => { e.preventDefault(); const words = el("words").value; el("words").value = ""; ask(words); });
for (const id of ["search", "room", "unsure"]) el(id).addEventListener("input", listThings);
for (const name of ["talk", "things"]) {
  el(`tab-${name}`).addEventListener("click", () => tab(name));
  el(`tab-${name}`).addEventListener("keydown", (e) => { if (e.key === "ArrowLeft" || e.key === "ArrowRight") { const other = name === "talk" ? "things" : "talk"; tab(other); el(`tab-${other}`).focus(); } });
}
el("flat").addEventListener("click", () => show(false));
el("points").addEventListener("input", () => { scene.shown = el("points").checked; scene.paint(); });
el("solid").addEventListener("click", () => show(true));
el("in").addEventListener("click", () => current().zoom(0.7));
el("out").addEventListener("click", () => current().zoom(1.4));
el("fit").addEventListener("click", () => current().fit());
el("theme").addEventListener("click", () => theme(!document.documentElement.classList.contains("dark")));
el("undo").addEventListener("click", () => safely(async () => { const told = await source.undo(); await reload(chosen); toast(told.done); if (el("undo").hidden) el("flat").focus(); }));
document.addEventListener("keydown", (e) => {
  if (e.key === "Escape" && !el("key").open) { stopPlacing(); choose(null); }
  if (e.key === "/" && !/INPUT|SELECT/.test(document.activeElement.tagName)) { e.preventDefault(); el("words").focus(); }
});
el("homes").addEventListener("change", () => safely(async () => { source.home = el("homes").value; el("turns").replaceChildren(); await reload(); }));
new ResizeObserver(() => { el("turns").scrollTop = el("turns").scrollHeight; }).observe(el("turns")); // the card takes its room from the talk
theme(matchMedia("(prefers-color-scheme: dark)").matches);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", (e) => theme(e.matches));
tab("talk");
listen();
safely(async () => {
  const homes = await source.homes();
  source.home = homes[0];
  el("homes").hidden = homes.length < 2; el("title").classList.toggle("hidden", homes.length > 1);
  el("homes").replaceChildren(...homes.map((h) => make("option", {}, h)));
  await reload();
  say("robot", make("p", {}, stored ? "Which thing are you looking for?" : "What do you need? Say it as you like."));
  document.documentElement.dataset.ready = "1";
});
