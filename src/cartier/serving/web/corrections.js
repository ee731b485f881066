"use strict";
// Corrections beside name, move and forget, which app.js has: confirm, relabel, merge, split, add, and the home's name.

function moreCorrections(obj, doing, idle) { // buttons for the card of an object
  return [
    obj.said || !obj.confirmed ? null : button("It is there", () => correct("confirm", obj, {})),
    button("It is a …", () => relabel(obj, doing, idle)), button("Same as …", () => mergeWith(obj, doing, idle)), button("It is two", () => split(obj, doing, idle)),
  ].filter(Boolean);
}
function relabel(obj, doing, idle) {
  const label = make("input", { "aria-label": "What it is", placeholder: "What is it?", maxlength: "60" });
  form(doing, idle, [label], () => correct("relabel", obj, { name: label.value }));
}
function mergeWith(obj, doing, idle) {
  const far = (t) => Math.hypot(t.at[0] - obj.at[0], t.at[1] - obj.at[1]), others = data.objects.filter((t) => t.id !== obj.id).sort((a, b) => far(a) - far(b)).slice(0, 20);
  const other = make("select", { "aria-label": "The same object as" }, ...others.map((t) => make("option", { value: String(t.id) }, `${called(t)} ${t.id}${t.confirmed ? "" : " ?"}, ${far(t).toFixed(1)} m away`)));
  form(doing, idle, [other], () => correct("merge", obj, { other: other.value }));
}
function split(obj, doing, idle) {
  const label = make("input", { "aria-label": "What the second one is", maxlength: "60", value: obj.label });
  form(doing, idle, [label], () => correct("split", obj, { name: label.value }));
  pointAt("Click the second one, or save to cut it in the middle", (x, y) => correct("split", obj, { name: label.value, x, y }));
  label.select();
}
function moreOfRooms(place, row) { // buttons beside the new name of a room
  const others = data.rooms.filter((r) => r.id !== place.id), work = (what, more) => corrected(() => source.correct(what, `room:${place.id}`, more));
  const other = make("select", { "aria-label": "The same room as" }, ...others.map((r) => make("option", { value: `room:${r.id}` }, r.name)));
  const cancel = () => { stopPlacing(); listObjects(); };
  return [
    others.length ? button("Same as …", () => { row.replaceChildren(); form(row, cancel, [other], () => work("merge", { other: other.value })); }) : null,
    button("It is two …", () => { row.replaceChildren("Click where one ends ", button("Cancel", cancel)); pointAt("Click where one room ends and the other begins", (x, y) => work("split", { x, y })); }),
  ].filter(Boolean);
}
function pointAt(hint, then) { // the next click on the plan gives a place
  if (el("plan").hasAttribute("hidden")) return;
  el("hint").textContent = hint; el("hint").hidden = false; el("plan").classList.add("placing");
  plan.placing = then;
}
function corrected(work) { // a correction that is about no object of the list
  return safely(async () => { const result = await work(); stopPlacing(); await reload(null); toast(`${result.done}. Undo takes it back.`); el("undo").focus(); });
}
function addObject() {
  const label = make("input", { id: "new-label", "aria-label": "What it is", placeholder: "What is missing?", maxlength: "60" }), row = make("div", {});
  const done = () => { stopPlacing(); row.remove(); el("add").hidden = false; el("add").focus(); };
  const put = (more) => (label.value.trim() ? corrected(() => source.correct("add", "", { name: label.value, ...more })).then(done) : label.focus());
  const room = make("select", { "aria-label": "Room" }, ...data.rooms.map((r) => make("option", { value: `room:${r.id}` }, `in the ${r.name}`)));
  el("add").hidden = true; el("add").after(row);
  form(row, done, data.rooms.length ? [label, room] : [label], () => put({ entity: room.value }));
  pointAt("Click where it stands, or save to put it into the room", (x, y) => put({ x, y }));
}
function renameHome() {
  const name = make("input", { "aria-label": "Name of this home", maxlength: "60", value: data.title }), row = make("div", {});
  const done = () => { row.remove(); el("name-home").hidden = false; };
  el("name-home").hidden = true; el("name-home").after(row);
  form(row, done, [name], () => corrected(() => source.correct("name", "home", { name: name.value })).then(done));
  name.select();
}
if (source.canCorrect) {
  el("list").before(make("button", { type: "button", id: "add", onclick: addObject }, "Add an object"));
  el("title").after(make("button", { type: "button", id: "name-home", class: "pen", "aria-label": "Name this home", onclick: renameHome }, "✎"));
}
