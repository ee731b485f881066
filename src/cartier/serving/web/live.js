"use strict";
// A home that is being mapped: the page follows the map as it grows, and shows where the camera is.

const EVERY_MS = 1000;

// Resolves once there is something to show: to whether the home is being mapped.
async function follow() {
  if (stored) return false;
  let state = await source.live();
  if (!state) return false;
  source.mapping = true;
  el("name-home").hidden = true; // corrections begin once the home is whole
  while (state && state.as_of_s === null && state.phase !== "failed") {
    strip(state);
    await pause();
    state = await source.live();
  }
  await safely(() => reload(null));
  grow();
  return true;
}
async function grow() {
  for (let state; ; await pause()) {
    try { state = await source.live(); } catch { strip(null); continue; } // the program may have ended
    if (!state) return;
    strip(state);
    plan.robot(state.camera);
    if (data && !busy && !plan.placing && state.home_id !== data.home_id) await safely(grown);
  }
}
async function grown() {
  const goal = plan.goal;
  data = await source.view();
  drawn(true);
  if (chosen !== null && !byId(chosen)) choose(null);
  else for (const v of views) { v.mark(chosen, offered); v.walk(goal); }
}
function strip(state) {
  const box = el("live");
  box.hidden = false;
  box.classList.toggle("past", !state || state.phase === "ended" || state.phase === "failed");
  if (!state) { box.textContent = "The program that maps does not answer."; return; }
  const left = Object.values(state.dropped).reduce((sum, n) => sum + n, 0), parts = [{ waiting: "Waiting for the first frame", mapping: "Mapping now", ended: "Mapping has ended", failed: "Mapping has failed" }[state.phase]];
  if (state.frames_in) parts.push(`${state.looked} of ${state.frames_in} frames looked at`);
  if (left) parts.push(`${left} left out`);
  if (state.as_of_s !== null) parts.push(`${Math.round(state.floor_seen * 100)} % of the floor seen`);
  if (state.delay_p50_s !== null) parts.push(`${state.delay_p50_s.toFixed(1)} s behind`);
  if (state.message && state.as_of_s === null) parts.push(state.message);
  box.textContent = parts.join(" · ");
  box.title = [state.message, ...Object.entries(state.dropped).map(([why, n]) => `${n} left out: ${why}`)].join("\n").trim();
}
const pause = () => new Promise((done) => { setTimeout(done, EVERY_MS); });
