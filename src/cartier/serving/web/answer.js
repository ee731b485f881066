"use strict";
// A tool's answer on the floor plan, inside a host that shows MCP Apps (SEP-1865, 2026-01-26). It talks to the host in JSON-RPC over postMessage.

const ANSWER = "cartier/answer"; // in the result's _meta
let result = null, chosen = null, next = 1;
const waiting = new Map();
const send = (message) => window.parent.postMessage({ jsonrpc: "2.0", ...message }, "*");
const notify = (method, params) => send({ method, params });
const request = (method, params) => new Promise((done, fail) => { waiting.set(next, { done, fail }); send({ id: next++, method, params }); });
const plan = new Plan(el("plan"), { choose: (t) => choose(t ? t.id : null), hover: tip });
const objectOf = (id) => plan.data.objects.find((t) => t.id === id);

window.addEventListener("message", (e) => {
  const message = e.data;
  if (e.source !== window.parent || !message || message.jsonrpc !== "2.0") return;
  if (!message.method && waiting.has(message.id)) {
    const { done, fail } = waiting.get(message.id);
    waiting.delete(message.id);
    if (message.error) fail(new Error(message.error.message)); else done(message.result);
  } else if (message.method === "ui/notifications/tool-result") show(message.params);
  else if (message.method === "ui/notifications/host-context-changed") dress(message.params);
  else if (message.method === "ui/notifications/tool-cancelled") el("what").textContent = "Cancelled.";
  else if (message.method === "ui/resource-teardown" || message.method === "ping") send({ id: message.id, result: {} });
  else if (message.id !== undefined && message.method) send({ id: message.id, error: { code: -32601, message: "unknown method" } });
});

function dress(context) {
  if (!context) return;
  if (context.theme) document.documentElement.classList.toggle("dark", context.theme === "dark");
  document.documentElement.classList.toggle("filled", Boolean(context.containerDimensions && context.containerDimensions.height));
  if (plan.data) draw();
}
function draw() { plan.draw(plan.data, css); choose(chosen); }
function show(message) {
  const about = message._meta && message._meta[ANSWER];
  if (!about) { el("what").textContent = message.isError ? message.content[0].text : "The host passed no floor plan on."; return; }
  result = about.result; plan.data = about.view;
  chosen = result.id === undefined ? null : result.id;
  el("stage").hidden = false;
  const rooms = plan.data.rooms.length > 1 ? ` in the ${result.room}` : "";
  el("what").textContent = result.text || result.question || (result.object || result.label ? `${result.name || result.object || result.label}${result.room ? rooms : ""}` : "");
  el("why").textContent = result.reason || "";
  el("certainty").textContent = result.certainty === undefined ? "" : `${Math.round(result.certainty * 100)} % sure: ${result.evidence}`;
  el("way").textContent = result.goal ? inWords(result.goal) : result.why_no_goal || "";
  if (about.photo) showPhoto(el("photo"), { src: `data:image/jpeg;base64,${about.photo.jpeg}`, box: about.photo.box }, objectOf(chosen));
  draw();
}
function choose(id) {
  chosen = id;
  const offered = about(), goal = result.goal && id === (result.id === undefined ? null : result.id) ? result.goal : null;
  plan.mark(id, offered);
  plan.walk(goal);
  el("this").hidden = result.status !== "clarify" || id === null;
  if (id !== null) el("this").textContent = `This one: ${called(objectOf(id))} ${id}`;
}
function about() { // the ids of the objects that the answer is about, null for all
  const names = result.status === "clarify" ? (result.candidates || []).map(([name]) => name) : [];
  const ids = result.ids || calledAny(plan.data.objects, names).map((t) => t.id);
  return ids.length ? new Set(ids) : null;
}
el("this").addEventListener("click", () => request("ui/message", { role: "user", content: [{ type: "text", text: `The ${called(objectOf(chosen))} ${chosen}.` }] }).catch((error) => { el("why").textContent = error.message; }));
new ResizeObserver(() => notify("ui/notifications/size-changed", { width: document.body.scrollWidth, height: document.body.scrollHeight })).observe(document.body);
document.documentElement.classList.toggle("dark", matchMedia("(prefers-color-scheme: dark)").matches);
request("ui/initialize", { protocolVersion: "2026-01-26", appInfo: { name: "cartier", version: "1" }, appCapabilities: { availableDisplayModes: ["inline", "fullscreen"] } })
  .then((host) => { dress(host.hostContext); notify("ui/notifications/initialized", {}); })
  .catch((error) => { el("what").textContent = error.message; });
