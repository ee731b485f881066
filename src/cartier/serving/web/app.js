"use strict";
// The page: a conversation and a list of objects beside the floor plan. An object chosen in one of them is chosen in all.

const stored = el("home-data"), source = stored ? new Stored(JSON.parse(stored.textContent)) : new Served();
const TABS = ["talk", "objects", "rules"];
let data = null, chosen = null, offered = null, busy = false;
const on = { choose: (t) => choose(t ? t.id : null), hover: tip, scaled: showScale };
const plan = new Plan(el("plan"), on), scene = new Scene(el("scene"), on), views = [plan, scene];
const byId = (id) => data.objects.find((t) => t.id === id);
const roomOf = (obj) => data.rooms.find((r) => r.id === obj.room);

function toast(text) {
  const box = el("toast");
  box.textContent = text; box.hidden = false;
  clearTimeout(toast.timer);
  toast.timer = setTimeout(() => { box.hidden = true; }, 6000);
}
async function safely(work) {
  try { return await work(); } catch (error) { if (error.name !== "AbortError") toast(error.message); return null; }
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
  const card = el("card"), obj = chosen === null ? null : byId(chosen);
  card.hidden = !obj;
  if (!obj) { card.replaceChildren(); return; }
  const size = obj.high.map((h, i) => Math.round((h - obj.low[i]) * 100)).join(" × "), room = roomOf(obj), on = obj.on && byId(obj.on[1]);
  const facts = [["Certainty", `${obj.said ? "a person said that it is there" : `${Math.round(obj.probability * 100)} %`}, detected in ${obj.n_detected} of ${obj.n_observable} frames`], ["Where", room ? room.name : `x ${obj.at[0].toFixed(2)} y ${obj.at[1].toFixed(2)}`], ["Way", make("span", { id: "way" }, inWords(goal))], on ? ["Stands", `${obj.on[0]} ${called(on)}`, "more"] : null, ["Size", `${size} cm`, "more"], obj.colours.length ? ["Colour", obj.colours.join(", "), "more"] : null, obj.names.length || obj.also.length ? ["Also", [...(obj.names.length ? [obj.label] : []), ...obj.also].join(", "), "more"] : null].filter(Boolean);
  const dl = make("dl", {}, ...facts.flatMap(([k, v, kind]) => [make("dt", { class: kind || null }, k), make("dd", { class: kind || null }, v)]));
  const photo = make("span", { class: "photo", hidden: "" }), doing = make("div", { class: "doing more" }), more = make("button", { type: "button", id: "more", "aria-expanded": "false", onclick: () => { card.classList.toggle("open"); more.setAttribute("aria-expanded", String(card.classList.contains("open"))); } }, "…");
  more.setAttribute("aria-label", "More about it");
  card.classList.remove("open");
  const idle = () => doing.replaceChildren(button("Rename", () => rename(obj, doing, idle)), button("Move", () => move(obj, doing, idle)), button("Forget", () => correct("forget", obj, {})), ...moreCorrections(obj, doing, idle));
  if (source.canCorrect) idle();
  card.replaceChildren(make("div", { class: "top" }, make("h2", {}, called(obj), make("span", { class: "muted" }, `${obj.confirmed ? "" : " ?"} ${obj.id}`)), make("span", { class: "grow" }), more, make("button", { type: "button", "aria-label": "Close", onclick: () => { choose(null); el("words").focus(); } }, "×")), photo, obj.confirmed ? "" : doubt(obj, source.canCorrect, (what) => correct(what, obj, {})), dl, doing);
  if (obj.views) safely(async () => showPhoto(photo, await source.photo(obj, 1), obj));
}
function form(doing, idle, fields, send) {
  const made = make("form", { class: "doing", onsubmit: (e) => { e.preventDefault(); send(); } }, ...fields, make("button", { class: "main" }, "Save"), button("Cancel", () => { stopPlacing(); idle(); }));
  doing.replaceChildren(made);
  fields[0].focus();
}
function rename(obj, doing, idle) {
  const name = make("input", { "aria-label": "New name", placeholder: "What do you call it?", maxlength: "60", value: obj.names[0] || "" });
  form(doing, idle, [name], () => correct("name", obj, { name: name.value }));
}
function move(obj, doing, idle) {
  const [x, y] = [0, 1].map((k) => make("input", { type: "number", step: "0.01", "aria-label": `${"xy"[k]} in metres`, value: obj.at[k].toFixed(2) }));
  form(doing, idle, [x, y], () => correct("move", obj, { x: Number(x.value), y: Number(y.value) }));
  if (el("plan").hasAttribute("hidden")) return;
  el("hint").textContent = "Click where it stands now"; el("hint").hidden = false; el("plan").classList.add("placing");
  plan.placing = (px, py) => { x.value = px.toFixed(2); y.value = py.toFixed(2); correct("move", obj, { x: px, y: py }); };
}
function stopPlacing() { plan.placing = null; el("hint").hidden = true; el("plan").classList.remove("placing"); }
function correct(what, obj, more) {
  return safely(async () => {
    const result = await source.correct(what, obj.id, more);
    stopPlacing();
    await reload(what === "forget" ? null : obj.id);
    toast(`${result.done}. Undo takes it back.`);
    (what === "forget" ? el("undo") : document.querySelector("#card .doing button")).focus({ preventScroll: true }); // the form that had the focus is closed
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
  try { const told = await source.ask(words); if (told.corrected || [...(told.rules || []), ...(told.lifts || [])].length) await reload(null); else if (source.mapping) await grown(); answer(waiting, told); } catch (error) { waiting.replaceChildren(make("p", {}, error.message)); }
  busy = false;
  waiting.scrollIntoView({ block: "nearest" });
}
function answer(into, result) {
  const parts = [], goalText = result.goal ? make("small", {}, inWords(result.goal)) : null;
  const head = result.text || (result.object ? `${result.status === "likely_near" ? "Likely near the " : ""}${result.name || result.object}${result.room ? `, in the ${result.room}` : ""}.` : result.question || "Nothing here serves that.");
  parts.push(make("p", {}, head[0].toUpperCase() + head.slice(1)), result.reason ? make("small", {}, result.reason) : null, goalText, ...(result.notes || []).map((n) => make("small", {}, n)));
  const ids = (result.ids || []).map(byId).filter(Boolean), names = result.status === "clarify" ? (result.candidates || []).map(([n]) => n) : [];
  const options = ids.length ? ids : calledAny(data.objects, names);
  offered = options.length ? new Set(options.map((t) => t.id)) : null;
  if (options.length) parts.push(make("div", { class: "choices" }, ...options.slice(0, 12).map((t) => { const b = button(apart(t, options), () => choose(t.id)); b.prepend(dot(t)); return b; })));
  into.replaceChildren(...parts.filter(Boolean));
  if (result.id !== undefined) choose(result.id, result.goal || undefined); else choose(result.tentative !== undefined && byId(result.tentative) ? result.tentative : null);
  for (const further of result.next || []) answer(say("robot", ""), further);
  if (el("mic").dataset.used) speechSynthesis.speak(new SpeechSynthesisUtterance(head));
}
function apart(obj, others) { // its name, and what distinguishes it from others of that name
  const same = others.filter((o) => called(o) === called(obj)), room = roomOf(obj), tells = (of) => new Set(same.map(of)).size === same.length;
  const colour = (t) => t.colours[0] || "", place = (t) => (roomOf(t) || { name: "" }).name;
  if (same.length === 1) return `${called(obj)}${room && data.rooms.length > 1 ? ` · ${room.name}` : ""}`;
  return `${called(obj)} · ${tells(place) ? place(obj) : tells(colour) ? colour(obj) : `${place(obj)} (${obj.id})`}`;
}
function dot(obj) {
  const made = make("span", { class: "dot", "aria-hidden": "true" });
  made.style.background = colourOf(obj);
  return made;
}

function listObjects() {
  const wanted = plain(el("search").value), room = el("room").value, fits = (t) => (room === "" || String(t.room) === room) && (!wanted || plain([...t.names, t.label, ...t.also, ...t.colours, (roomOf(t) || { name: "" }).name].join(" ")).includes(wanted));
  const found = data.objects.filter(fits), sure = found.filter((t) => t.confirmed), unsure = found.filter((t) => !t.confirmed).sort((a, b) => b.probability - a.probability), rows = [], places = [...data.rooms, { id: null, name: data.rooms.length ? "elsewhere" : "objects" }];
  const row = (t) => {
    const made = make("button", { type: "button", "aria-current": String(t.id === chosen), onclick: () => choose(t.id) }, t.confirmed ? dot(t) : make("i", { class: "unsure" }), `${called(t)}${t.confirmed ? "" : " ?"}`, make("span", { class: "muted" }, `${Math.round(t.probability * 100)} %`));
    made.dataset.id = t.id;
    return make("li", {}, made);
  };
  for (const place of places) {
    const here = sure.filter((t) => t.room === place.id || (place.id === null && !roomOf(t))).sort((a, b) => called(a).localeCompare(called(b)) || a.id - b.id);
    if (here.length) rows.push(make("li", {}, make("h2", {}, `${place.name}${place.area ? `, ${place.area} m²` : ""} `, source.canCorrect && place.id !== null ? make("button", { type: "button", class: "pen", "aria-label": `Rename ${place.name}`, onclick: () => renameRoom(place) }, "✎︎") : null)), ...here.map(row));
  }
  if (!sure.length) rows.push(make("li", { class: "muted" }, "No object matches."));
  if (unsure.length && el("tentative").checked) rows.push(make("li", {}, make("h2", {}, `not sure: ${unsure.length}`)), ...unsure.map(row));
  else if (unsure.length) rows.push(make("li", {}, make("button", { type: "button", class: "muted", onclick: () => el("tentative").click() }, make("i", { class: "unsure" }), `Show ${unsure.length} more that the map is not sure of`)));
  el("list").replaceChildren(...rows);
  el("count").textContent = String(data.objects.filter((t) => t.confirmed).length);
  offered = wanted || room !== "" ? new Set((el("tentative").checked ? found : sure).map((t) => t.id)) : null;
  for (const v of views) { v.tentative = el("tentative").checked; v.mark(chosen, offered); }
}
function showScale(perMetre) { // a round length of 40 to 120 pixels
  const metres = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50].find((m) => m * perMetre >= 40) || 100, [bar, text] = el("scale").children;
  bar.style.width = `${metres * perMetre}px`; text.textContent = `${metres} m`;
}
function renameRoom(place) {
  const name = make("input", { "aria-label": `New name of ${place.name}`, maxlength: "60", value: place.name }), row = [...el("list").querySelectorAll("h2")].find((h) => h.textContent.startsWith(place.name));
  row.replaceChildren(make("form", { class: "doing", onsubmit: (e) => { e.preventDefault(); safely(async () => { const result = await source.correct("name", `room:${place.id}`, { name: name.value }); await reload(chosen); toast(`${result.done}. Undo takes it back.`); }); } }, name, make("button", { class: "main" }, "Save"), ...moreOfRooms(place, row), button("Cancel", listObjects)));
  name.focus(); name.select();
}

async function reload(keep) {
  data = await source.view();
  drawn();
  choose(keep !== undefined && keep !== null && byId(keep) ? keep : null);
}
function drawn(stay) { // stay: the plan keeps its place and size
  document.title = `${data.title} · cartier`;
  el("title").textContent = data.title;
  const sure = data.objects.filter((t) => t.confirmed).length, maybe = data.objects.length - sure, age = data.age_h === undefined ? "" : data.age_h < 1 ? ", mapped within the hour" : data.age_h < 48 ? `, mapped ${Math.round(data.age_h)} h ago` : `, mapped ${Math.round(data.age_h / 24)} days ago`;
  el("about").textContent = `${sure} objects${data.rooms.length ? `, ${data.rooms.length} room${data.rooms.length > 1 ? "s" : ""}` : ""}${age}`;
  el("unsure").textContent = `not sure (${maybe})`; el("tentative-on").hidden = !maybe;
  el("about").title = [data.detector, ...data.notes].join("\n");
  el("undo").hidden = !source.canCorrect || !data.corrections;
  const room = el("room").value;
  el("room").replaceChildren(make("option", { value: "" }, "all rooms"), ...data.rooms.map((r) => make("option", { value: String(r.id) }, r.name)));
  el("room").value = room;
  plan.draw(data, css, stay); scene.draw(data, css, plan.whole, stay);
  loadPoints();
  listObjects();
  listRules();
}
function tab(which) {
  for (const name of TABS) { el(name).hidden = name !== which; el(`tab-${name}`).setAttribute("aria-selected", String(name === which)); el(`tab-${name}`).tabIndex = name === which ? 0 : -1; }
}
function show(solid) {
  if (solid) { el("scene").hidden = false; if (!scene.start()) { el("scene").hidden = true; toast("This browser has no WebGL2."); return; } }
  el("plan").toggleAttribute("hidden", solid); el("scene").hidden = !solid;
  el("flat").setAttribute("aria-pressed", String(!solid)); el("solid").setAttribute("aria-pressed", String(solid));
  stopPlacing();
  el("points-on").hidden = !solid || !scene.cloud; el("names").toggleAttribute("hidden", !solid);
  el("stage").classList.toggle("solid", solid);
  if (solid) { scene.paint(); loadPoints(); } else plan.name();
}
function loadPoints() { // only once the 3-D view is open
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
function listen() { // speech recognition by the browser, where it has one
  const Recognition = window.SpeechRecognition || window.webkitSpeechRecognition;
  if (!Recognition || !window.speechSynthesis || stored) return;
  el("mic").hidden = false;
  el("mic").addEventListener("click", () => {
    const recognition = new Recognition();
    el("mic").dataset.used = "1";
    recognition.lang = navigator.language;
    recognition.onresult = (e) => ask(e.results[0][0].transcript);
    recognition.onerror = (e) => toast(`The browser recognised no words (${e.error}).`);
    recognition.start();
  });
}

// On a phone the keyboard covers a part of the page: what is left of it holds the field and the evidence.
function viewport() {
  const seen = window.visualViewport, root = document.documentElement;
  if (!seen) return;
  const height = seen.height * seen.scale;
  root.style.setProperty("--height", `${Math.round(height)}px`);
  root.style.setProperty("--top", `${Math.round(seen.scale > 1 ? 0 : seen.offsetTop)}px`);
  root.classList.toggle("typing", innerWidth <= 760 && height < 560);
}

const current = () => (el("scene").hidden ? plan : scene);
el("ask").addEventListener("submit", (e) => { e.preventDefault(); const words = el("words").value; el("words").value = ""; ask(words); });
for (const id of ["search", "room", "tentative"]) el(id).addEventListener("input", listObjects);
for (const [k, name] of TABS.entries()) {
  el(`tab-${name}`).addEventListener("click", () => tab(name));
  el(`tab-${name}`).addEventListener("keydown", (e) => { if (e.key === "ArrowLeft" || e.key === "ArrowRight") { const other = TABS[(k + (e.key === "ArrowLeft" ? TABS.length - 1 : 1)) % TABS.length]; tab(other); el(`tab-${other}`).focus(); } });
}
el("flat").addEventListener("click", () => show(false));
el("points").addEventListener("input", () => { scene.shown = el("points").checked; scene.paint(); });
el("solid").addEventListener("click", () => show(true));
el("in").addEventListener("click", () => current().zoom(0.7));
el("out").addEventListener("click", () => current().zoom(1.4));
el("fit").addEventListener("click", () => current().fit());
el("theme").addEventListener("click", () => theme(!document.documentElement.classList.contains("dark")));
el("undo").addEventListener("click", () => safely(async () => { const result = await source.undo(); await reload(chosen); toast(result.done); if (el("undo").hidden) el("flat").focus(); }));
document.addEventListener("keydown", (e) => {
  if (e.key === "Escape" && !el("key").open) { stopPlacing(); choose(null); }
  if (e.key === "/" && !/INPUT|SELECT/.test(document.activeElement.tagName)) { e.preventDefault(); el("words").focus(); }
});
el("homes").addEventListener("change", () => safely(async () => { source.home = el("homes").value; el("turns").replaceChildren(); await reload(); }));
new ResizeObserver(() => { el("turns").scrollTop = el("turns").scrollHeight; }).observe(el("turns")); // keep the last turn in view when the card opens
if (window.visualViewport) for (const change of ["resize", "scroll"]) visualViewport.addEventListener(change, viewport);
viewport();
theme(matchMedia("(prefers-color-scheme: dark)").matches);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", (e) => theme(e.matches));
tab("talk");
listen();
safely(async () => {
  const homes = await source.homes();
  source.home = homes[0];
  el("homes").hidden = homes.length < 2; el("title").classList.toggle("hidden", homes.length > 1);
  el("homes").replaceChildren(...homes.map((h) => make("option", {}, h)));
  if (!(await follow())) await reload();
  say("robot", make("p", {}, stored ? "Which object are you looking for?" : "What do you need? Say it as you like."));
  document.documentElement.dataset.ready = "1";
});
