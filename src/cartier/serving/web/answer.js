"use strict";
// A tool's answer on the floor plan, inside a host that shows MCP Apps (SEP-1865, 2026-01-26): JSON-RPC over postMessage with the host.

const ANSWER = "cartier/answer"; // in the result's _meta
let told = null, chosen = null, next = 1;
const waiting = new Map();
const send = (message) => window.parent.postMessage({ jsonrpc: "2.0", ...message }, "*");
const notify = (method, params) => send({ method, params });
const request = (method, params) => new Promise((done, fail) => { waiting.set(next, { done, fail }); send({ id: next++, method, params }); });
const plan = new Plan(el("plan"), { choose: (t) => choose(t ? t.id : null), hover: tip });
const thingOf = (id) => plan.data.objects.find((t) => t.id === id);

window.addEventListener("message", (e) => {
  const said = e.data;
  if (e.source !== window.parent || !said || said.jsonrpc !== "2.0") return;
  if (!said.method && waiting.has(said.id)) {
    const { done, fail } = waiting.get(said.id);
    waiting.delete(said.id);
    if (said.error) fail(new Error(said.error.message)); else done(said.result);
  } else if (said.method === "ui/notifications/tool-result") show(said.params);
  else if (said.method === "ui/notifications/host-context-changed") dress(said.params);
  else if (said.method === "ui/notifications/tool-cancelled") el("what").textContent = "Cancelled.";
  else if (said.method === "ui/resource-teardown" || said.method === "ping") send({ id: said.id, result: {} });
  else if (said.id !== undefined && said.method) send({ id: said.id, error: { code: -32601, message: "unknown method" } });
});

function dress(context) {
  if (!context) return;
  if (context.theme) document.documentElement.classList.toggle("dark", context.theme === "dark");
  document.documentElement.classList.toggle("filled", Boolean(context.containerDimensions && context.containerDimensions.height));
  if (plan.data) draw();
}
function draw() { plan.draw(plan.data, css); choose(chosen); }
function show(result) {
  const about = result._meta && result._meta[ANSWER];
  if (!about) { el("what").textContent = result.isError ? result.content[0].text : "The host passed no floor plan on."; return; }
  told = about.told; plan.data = about.view;
  chosen = told.id === undefined ? null : told.id;
  el("stage").hidden = false;
  const rooms = plan.data.rooms.length > 1 ? ` in the ${told.room}` : "";
  el("what").textContent = told.text || told.question || (told.object || told.label ? `${told.name || told.object || told.label}${told.room ? rooms : ""}` : "");
  el("why").textContent = told.reason || "";
  el("sure").textContent = told.certainty === undefined ? "" : `${Math.round(told.certainty * 100)} % sure: ${told.evidence}`;
  el("way").textContent = told.goal ? inWords(told.goal) : told.why_no_goal || "";
  if (about.photo) showPhoto(el("photo"), { src: `data:image/jpeg;base64,${about.photo.jpeg}`, box: about.photo.box }, thingOf(chosen));
  draw();
}
function choose(id) {
  chosen = id;
  const offered = about(), goal = told.goal && id === (told.id === undefined ? null : told.id) ? told.goal : null;
  plan.mark(id, offered);
  plan.walk(goal);
  el("this").hidden = told.status !== "clarify" || id === null;
  if (id !== null) el("this").textContent = `This one: ${called(thingOf(id))} ${id}`;
}
function about() { // the objects that the answer is about, null for all
  const names = told.status === "clarify" ? (told.candidates || []).map(([name]) => name) : [];
  const ids = told.ids || plan.data.objects.filter((t) => t.confirmed && (names.includes(t.label) || t.names.some((n) => names.includes(n)))).map((t) => t.id);
  return ids.length ? new Set(ids) : null;
}
el("this").addEventListener("click", () => request("ui/message", { role: "user", content: [{ type: "text", text: `The ${called(thingOf(chosen))} ${chosen}.` }] }).catch((error) => { el("why").textContent = error.message; }));
new ResizeObserver(() => notify("ui/notifications/size-changed", { width: document.body.scrollWidth, height: document.body.scrollHeight })).observe(document.body);
document.documentElement.classList.toggle("dark", matchMedia("(prefers-color-scheme: dark)").matches);
request("ui/initialize", { protocolVersion: "2026-01-26", appInfo: { name: "cartier", version: "1" }, appCapabilities: { availableDisplayModes: ["inline", "fullscreen"] } })
  .then((host) => { dress(host.hostContext); notify("ui/notifications/initialized", {}); })
  .catch((error) => { el("what").textContent = error.message; });
