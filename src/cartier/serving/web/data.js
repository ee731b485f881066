"use strict";
// The page's data source: a server (Served), or the JSON that is stored in the page itself (Stored).

const plain = (text) => text.toLowerCase().normalize("NFKD").replace(/[^\p{L}\p{N} ]+/gu, " ").replace(/\s+/g, " ").trim();

class Served {
  constructor() { this.home = ""; this.reads = new AbortController(); this.mapping = false; this.token = sessionStorage.getItem("cartier-token") || ""; this.talk = Array.from(crypto.getRandomValues(new Uint8Array(12)), (b) => b.toString(16).padStart(2, "0")).join(""); }
  get canCorrect() { return !this.mapping; }
  async call(path, body, signal) {
    const headers = this.token ? { authorization: `Bearer ${this.token}` } : {};
    if (body) headers["content-type"] = "application/json";
    const got = await fetch(path, { method: body ? "POST" : "GET", headers, body: body && JSON.stringify(body), credentials: "omit", signal });
    if (got.status === 401) { await this.unlock(); return this.call(path, body, signal); }
    if (!got.ok) throw new Error((await got.json().catch(() => ({}))).error || `the server answered ${got.status}`);
    return got;
  }
  unlock() {
    const box = document.getElementById("key"), token = document.getElementById("token");
    token.value = "";
    return new Promise((done) => {
      box.addEventListener("close", () => { this.token = token.value.trim(); sessionStorage.setItem("cartier-token", this.token); done(); }, { once: true });
      box.showModal();
    });
  }
  json(path, body, signal) { return this.call(path, body, signal).then((got) => got.json()); }
  at(rest) { return `api/homes/${encodeURIComponent(this.home)}/${rest}`; }
  async homes() { return (await this.json("api/homes")).homes; }
  view() { return this.json(this.at("view")); }
  async live() { return (await this.json(this.at("live"))).live; }
  async cloud() { return (await this.json(this.at("cloud"))).cloud; }
  ask(words) { return this.json(this.at("ask"), { words, conversation: this.talk }); }
  async goal(obj) { const result = await this.json(this.at(`goal?entity=${obj.id}`), undefined, this.reads.signal); return result.goal || { why: result.why_no_goal }; }
  async photo(obj, view) {
    const got = await this.call(this.at(`photo?entity=${obj.id}&view=${view}`), undefined, this.reads.signal);
    return { src: URL.createObjectURL(await got.blob()), box: JSON.parse(got.headers.get("x-box")) };
  }
  forgetReads() { this.reads.abort(); this.reads = new AbortController(); } // of a home that is about to change
  correct(what, entity, more) { this.forgetReads(); return this.json(this.at("corrections"), { what, entity: String(entity), who: "the page", ...more }); }
  undo() { this.forgetReads(); return this.json(this.at("undo"), { who: "the page" }); }
}

class Stored {
  constructor(data) { this.data = data; this.home = data.home; }
  get canCorrect() { return false; }
  async homes() { return [this.data.home]; }
  async view() { return this.data; }
  async cloud() { return this.data.cloud; }
  async goal(obj) { return this.data.goals[obj.id] || { why: "no reachable pose near it" }; }
  async photo(obj) { const p = this.data.photos[obj.id]; return p && { src: `data:image/jpeg;base64,${p.jpeg}`, box: p.box }; }
  // There is no reasoner without a server: words are looked up among names, labels, rooms and colours.
  async ask(words) {
    const asked = plain(words).split(" ").map((w) => w.replace(/(ss)$|(?<!s)s$/, "$1")), said = ` ${asked.join(" ")} `;
    const key = (name) => plain(name).split(" ").map((w) => w.replace(/(ss)$|(?<!s)s$/, "$1")).join(" ");
    const rooms = new Map(this.data.rooms.map((r) => [r.id, r]));
    let best = [], most = 0;
    for (const obj of this.data.objects.filter((t) => t.confirmed)) {
      const names = [...obj.names, obj.label, ...obj.also].map(key), hit = names.filter((n) => n && said.includes(` ${n} `)).sort((a, b) => b.length - a.length)[0];
      if (!hit) continue;
      const room = rooms.get(obj.room), extra = (room && said.includes(` ${key(room.name)} `) ? 5 : 0) + obj.colours.filter((c) => asked.includes(c)).length * 3;
      const worth = hit.length + (names.indexOf(hit) < obj.names.length + 1 ? 2 : 0) + extra;
      if (worth > most) { best = []; most = worth; }
      if (worth === most) best.push(obj);
    }
    if (!best.length) {
      const label = this.serves(asked);
      best = this.data.objects.filter((t) => t.confirmed && t.label === label);
    }
    if (!best.length) return { status: "not_found", reason: "No object here has such a name or use. This file only compares words: serve the home to ask anything.", goal: null };
    if (/\bhow many\b/i.test(words)) return { status: "answered", text: `${best.length} × ${best[0].label}`, ids: best.map((t) => t.id), goal: null };
    if (best.length > 1) return { status: "clarify", question: `There are ${best.length}. Which one?`, ids: best.map((t) => t.id), goal: null };
    return { status: "found", object: called(best[0]), id: best[0].id, goal: this.data.goals[best[0].id] };
  }
  // The label whose uses share the rarest words with the request; null below a threshold.
  serves(asked) {
    const split = (text) => new Set(plain(text).split(" ")), phrases = Object.entries(this.data.uses).flatMap(([label, uses]) => uses.map((u) => [label, split(u)])), count = new Map();
    for (const [, words] of phrases) for (const w of words) count.set(w, (count.get(w) || 0) + 1);
    const worth = (w) => Math.log(phrases.length / count.get(w)), wanted = [...new Set(asked)].filter((w) => count.has(w));
    const scored = phrases.map(([label, words]) => [wanted.filter((w) => words.has(w)).reduce((sum, w) => sum + worth(w), 0) / Math.sqrt(words.size), label]).sort((a, b) => b[0] - a[0]);
    return scored.length && scored[0][0] > 1.8 ? scored[0][1] : null;
  }
}
