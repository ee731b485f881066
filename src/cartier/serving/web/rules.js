"use strict";
// The route rules of the home: what people said of how to drive, with the sentence that made each, and a button that takes it back.

function listRules() {
  const rows = data.rules.map((rule) => make("li", {},
    make("p", {}, `${rule.words[0].toUpperCase()}${rule.words.slice(1)}`, rule.holds === "now" ? null : make("span", { class: "muted" }, ` (${rule.holds})`)),
    rule.said ? make("small", {}, `“${rule.said}”`) : null,
    source.canCorrect ? button("Take back", () => takeBack(rule)) : null));
  if (!rows.length) rows.push(make("li", { class: "muted" }, source.canCorrect ? "No rules. Say one: “never through the bedroom”." : "No rules."));
  el("rule-list").replaceChildren(...rows);
  el("rule-count").textContent = data.rules.length ? String(data.rules.length) : "";
}
function takeBack(rule) {
  return safely(async () => { const result = await source.correct("lift", rule.id, {}); await reload(null); toast(`${result.done}. Undo takes it back.`); el("tab-rules").focus(); });
}
