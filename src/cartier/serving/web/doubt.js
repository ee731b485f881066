"use strict";
// A tentative object: its photo is shown, and a person says whether it is what the map takes it for.

const article = (name) => (/^[aeiou]/i.test(name) ? `an ${name}` : `a ${name}`);
// The question below the photo. `correct(what)` sends what the person says: "confirm" or "forget".
function doubt(obj, canCorrect, correct) {
  const seen = `Not sure: seen in ${obj.n_detected} of ${obj.n_observable} frames that could show it.`;
  if (!canCorrect) return make("p", { class: "doubt muted" }, seen);
  const said = (what) => async () => { for (const b of choices.children) b.disabled = true; await correct(what); for (const b of choices.children) b.disabled = false; };
  const choices = make("div", { class: "choices" }, button("Yes", said("confirm"), "main yes"), button("No", said("forget"), "no"));
  return make("div", { class: "doubt", role: "group", "aria-label": "Is it there?", title: seen }, make("p", {}, `I am not sure. Is ${obj.views ? "this" : "there"} ${article(called(obj))}?`), choices);
}
