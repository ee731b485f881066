"use strict";
// The home in 3-D with plain WebGL2: the floor plan as columns and each object as a box in its colour, or the point cloud with
// transparent boxes.

const CUT_M = 1.2; // height at which walls are cut
const VERTEX = `#version 300 es
in vec3 corner; in vec3 normal; in vec3 low; in vec3 size; in vec4 colour;
uniform mat4 view; uniform vec3 sun; out vec4 shade;
void main() {
  gl_Position = view * vec4(low + corner * size, 1.0);
  shade = vec4(colour.rgb * (0.62 + 0.38 * max(dot(normal, sun), 0.0)), colour.a);
}`;
const FRAGMENT = `#version 300 es
precision mediump float; in vec4 shade; out vec4 drawn; void main() { drawn = vec4(shade.rgb * shade.a, shade.a); }`;
// A point is drawn as a disc that falls off to its rim, so that of two that overlap each is seen where it is the nearer one.
const POINT_VERTEX = `#version 300 es
in vec3 place; in vec3 tint; in float wide; uniform mat4 view; uniform vec3 low; uniform float step_m; uniform float pixels; uniform float lens;
out vec3 shade; out float fall;
void main() {
  gl_Position = view * vec4(low + place * step_m, 1.0);
  float w = gl_Position.w, size = wide * step_m;
  gl_PointSize = clamp(pixels * size / w, 2.0, 64.0); fall = 0.25 * lens * size / (w * (w + size)); shade = tint;
}`;
const POINT_FRAGMENT = `#version 300 es
precision highp float; in vec3 shade; in float fall; out vec4 drawn;
void main() { vec2 off = 2.0 * gl_PointCoord - 1.0; float far = dot(off, off); if (far > 1.0) discard; gl_FragDepth = gl_FragCoord.z + fall * far; drawn = vec4(shade, 1.0); }`;
const FLOOR_VERTEX = `#version 300 es
uniform mat4 view; uniform vec4 area; out vec2 at;
void main() { at = vec2(gl_VertexID & 1, gl_VertexID >> 1); gl_Position = view * vec4(area.xy + at * area.zw, -0.03, 1.0); }`;
const FLOOR_FRAGMENT = `#version 300 es
precision mediump float; uniform sampler2D seen; in vec2 at; out vec4 drawn;
void main() { vec4 found = texture(seen, at); if (found.a < 0.5) discard; drawn = vec4(found.rgb / found.a, 1.0); }`;
const FLOOR_M = 0.08, SPREAD_M = 0.35; // floor points lie no higher; how far their colours reach into cells that hold none

function built(gl, vertex, fragment) {
  const program = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) { const s = gl.createShader(kind); gl.shaderSource(s, source); gl.compileShader(s); gl.attachShader(program, s); }
  gl.linkProgram(program);
  return program;
}

function* edges(obj, thick) { // the edges of an object's box as thin boxes
  const ends = [obj.low, obj.high];
  for (let axis = 0; axis < 3; axis++) for (const u of [0, 1]) for (const v of [0, 1]) {
    const low = [0, 0, 0], high = [0, 0, 0], [i, j] = [(axis + 1) % 3, (axis + 2) % 3];
    low[axis] = obj.low[axis] - thick; high[axis] = obj.high[axis] + thick;
    for (const [k, end] of [[i, u], [j, v]]) { low[k] = ends[end][k] - thick; high[k] = ends[end][k] + thick; }
    yield [low, high];
  }
}

class Scene {
  constructor(canvas, on) {
    this.canvas = canvas; this.on = on; this.turn = -0.9; this.tilt = 0.85; this.far = 10; this.middle = [0, 0, 0.4]; this.chosen = null; this.only = null; this.goal = null; this.cloud = null; this.shown = true; this.tentative = false; this.names = el("names");
    canvas.addEventListener("wheel", (e) => { e.preventDefault(); this.zoom(Math.exp(e.deltaY * 0.0015)); }, { passive: false });
    canvas.addEventListener("keydown", (e) => {
      const to = { ArrowLeft: [-0.15, 0], ArrowRight: [0.15, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] }[e.key];
      if (to) this.rotate(...to); else if (e.key === "+" || e.key === "=") this.zoom(0.8); else if (e.key === "-") this.zoom(1.25); else return;
      e.preventDefault();
    });
    let last = null, moved = 0;
    canvas.addEventListener("pointerdown", (e) => { last = e; moved = 0; canvas.setPointerCapture(e.pointerId); });
    canvas.addEventListener("pointermove", (e) => {
      if (!last) { this.on.hover(this.under(e), e); return; }
      moved += Math.abs(e.clientX - last.clientX) + Math.abs(e.clientY - last.clientY);
      if (e.shiftKey || e.buttons === 2) this.slide(e.clientX - last.clientX, e.clientY - last.clientY);
      else this.rotate((last.clientX - e.clientX) * 0.008, (e.clientY - last.clientY) * 0.006);
      last = e;
    });
    canvas.addEventListener("pointerup", (e) => { if (moved < 6) this.on.choose(this.under(e)); last = null; });
    canvas.addEventListener("pointercancel", () => { last = null; });
    canvas.addEventListener("contextmenu", (e) => e.preventDefault());
    canvas.addEventListener("pointerleave", (e) => this.on.hover(null, e));
    new ResizeObserver(() => this.paint()).observe(canvas);
  }
  start() {
    if (this.gl) return true;
    const gl = this.canvas.getContext("webgl2", { antialias: true, preserveDrawingBuffer: true });
    if (!gl) return false;
    const program = built(gl, VERTEX, FRAGMENT), dots = built(gl, POINT_VERTEX, POINT_FRAGMENT);
    this.program = program; this.dots = dots;
    this.dotsWhere = Object.fromEntries(["view", "low", "step_m", "pixels", "lens"].map((name) => [name, gl.getUniformLocation(dots, name)]));
    this.dotsArray = gl.createVertexArray(); this.places = gl.createBuffer(); this.tints = gl.createBuffer(); this.wides = gl.createBuffer();
    gl.bindVertexArray(this.dotsArray);
    for (const [buffer, name, kind, normal, n] of [[this.places, "place", gl.UNSIGNED_SHORT, false, 3], [this.tints, "tint", gl.UNSIGNED_BYTE, true, 3], [this.wides, "wide", gl.UNSIGNED_BYTE, false, 1]]) { gl.bindBuffer(gl.ARRAY_BUFFER, buffer); const at = gl.getAttribLocation(dots, name); gl.enableVertexAttribArray(at); gl.vertexAttribPointer(at, n, kind, normal, 0, 0); }
    gl.bindVertexArray(null);
    this.ground = built(gl, FLOOR_VERTEX, FLOOR_FRAGMENT); this.groundWhere = Object.fromEntries(["view", "area"].map((name) => [name, gl.getUniformLocation(this.ground, name)]));
    this.groundArray = gl.createVertexArray(); this.picture = gl.createTexture();
    const faces = [];
    for (let axis = 0; axis < 3; axis++) for (const end of [0, 1]) {
      const u = (axis + 1) % 3, v = (axis + 2) % 3, normal = [0, 0, 0]; normal[axis] = end ? 1 : -1;
      for (const [a, b] of [[0, 0], [1, 0], [1, 1], [0, 0], [1, 1], [0, 1]]) { const p = [0, 0, 0]; p[axis] = end; p[u] = a; p[v] = b; faces.push(...p, ...normal); }
    }
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(faces), gl.STATIC_DRAW);
    const at = (name) => gl.getAttribLocation(program, name);
    for (const [name, offset] of [["corner", 0], ["normal", 12]]) { gl.enableVertexAttribArray(at(name)); gl.vertexAttribPointer(at(name), 3, gl.FLOAT, false, 24, offset); }
    this.boxes = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, this.boxes);
    for (const [name, n, offset] of [["low", 3, 0], ["size", 3, 12], ["colour", 4, 24]]) { gl.enableVertexAttribArray(at(name)); gl.vertexAttribPointer(at(name), n, gl.FLOAT, false, 40, offset); gl.vertexAttribDivisor(at(name), 1); }
    this.where = { view: gl.getUniformLocation(program, "view"), sun: gl.getUniformLocation(program, "sun") };
    gl.enable(gl.DEPTH_TEST); gl.enable(gl.BLEND); gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    this.gl = gl;
    return true;
  }
  load(cloud) { // null for none
    this.cloud = null;
    if (cloud) {
      const bytes = Uint8Array.from(atob(cloud.points), (c) => c.charCodeAt(0)), n = cloud.count, kept = this.below(cloud, new Uint16Array(bytes.buffer, 0, 3 * n)), gl = this.gl;
      const places = new Uint16Array(3 * kept.length), tints = new Uint8Array(3 * kept.length), wides = new Uint8Array(kept.length), all = new Uint16Array(bytes.buffer, 0, 3 * n);
      kept.forEach((from, to) => { wides[to] = bytes[9 * n + from]; for (let i = 0; i < 3; i++) { places[3 * to + i] = all[3 * from + i]; tints[3 * to + i] = bytes[6 * n + 3 * from + i]; } });
      for (const [buffer, values] of [[this.places, places], [this.tints, tints], [this.wides, wides]]) { gl.bindBuffer(gl.ARRAY_BUFFER, buffer); gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW); }
      this.cloud = { ...cloud, points: null, count: kept.length, places, wides };
      this.floor = this.data.grid ? this.texture(this.data.grid, this.cloud, tints) : null;
    }
    this.paint();
  }
  // The floor as it was seen: the mean colour of the floor's points in each cell; cells between them take their neighbours'.
  texture(grid, cloud, tints) {
    const gl = this.gl, side = Math.max(cloud.side, grid.cols * grid.side / 1024, grid.rows * grid.side / 1024), wide = Math.ceil(grid.cols * grid.side / side), tall = Math.ceil(grid.rows * grid.side / side);
    const sum = new Float32Array(4 * wide * tall), known = expand(grid.cells, grid.rows * grid.cols), free = (c, r) => known[Math.min(grid.rows - 1, Math.floor((r + 0.5) * side / grid.side)) * grid.cols + Math.min(grid.cols - 1, Math.floor((c + 0.5) * side / grid.side))] !== 0;
    for (let k = 0; k < cloud.count; k++) {
      const [x, y, z] = [0, 1, 2].map((i) => cloud.low[i] + cloud.places[3 * k + i] * cloud.step), c = Math.floor((x - grid.origin[0]) / side), r = Math.floor((y - grid.origin[1]) / side), at = 4 * (r * wide + c);
      if (Math.abs(z) > FLOOR_M || c < 0 || r < 0 || c >= wide || r >= tall) continue;
      for (let i = 0; i < 3; i++) sum[at + i] += tints[3 * k + i];
      sum[at + 3]++;
    }
    for (let at = 0; at < sum.length; at += 4) if (sum[at + 3]) { for (let i = 0; i < 3; i++) sum[at + i] /= sum[at + 3]; sum[at + 3] = 1; }
    for (let pass = 0; pass < Math.ceil(SPREAD_M / side); pass++) {
      const before = sum.slice();
      for (let r = 0; r < tall; r++) for (let c = 0; c < wide; c++) {
        const at = 4 * (r * wide + c);
        if (before[at + 3] || !free(c, r)) continue;
        const near = [[c - 1, r], [c + 1, r], [c, r - 1], [c, r + 1]].filter(([u, v]) => u >= 0 && v >= 0 && u < wide && v < tall).map(([u, v]) => 4 * (v * wide + u)).filter((from) => before[from + 3]);
        if (near.length) { for (let i = 0; i < 3; i++) sum[at + i] = near.reduce((total, from) => total + before[from + i], 0) / near.length; sum[at + 3] = 1; }
      }
    }
    const pixels = Uint8Array.from(sum, (v, i) => (i % 4 === 3 ? v * 255 : v * sum[i - i % 4 + 3]));
    gl.bindTexture(gl.TEXTURE_2D, this.picture);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, wide, tall, 0, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    for (const [name, value] of [[gl.TEXTURE_MIN_FILTER, gl.LINEAR], [gl.TEXTURE_MAG_FILTER, gl.LINEAR], [gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE], [gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE]]) gl.texParameteri(gl.TEXTURE_2D, name, value);
    return [...grid.origin, wide * side, tall * side];
  }
  below(cloud, places) { // the points to draw: all below the cut, and those of confirmed objects above it
    const kept = [], whole = this.data.objects.filter((t) => t.confirmed && t.high[2] > CUT_M);
    for (let k = 0; k < cloud.count; k++) {
      const p = [0, 1, 2].map((i) => cloud.low[i] + places[3 * k + i] * cloud.step);
      if (p[2] <= CUT_M || whole.some((t) => p.every((v, i) => v > t.low[i] - 0.05 && v < t.high[i] + 0.05))) kept.push(k);
    }
    return kept;
  }
  draw(data, css, whole, stay) {
    const before = stay && this.data;
    this.data = data; this.css = css;
    if (before) { this.paint(); return; }
    this.middle = [whole.x + whole.w / 2, -(whole.y + whole.h / 2), 0.4];
    this.fitted = this.far = Math.hypot(whole.w, whole.h) * 1.18;
    this.paint();
  }
  fit() { this.far = this.fitted; this.turn = -0.9; this.tilt = 0.85; this.paint(); }
  zoom(by) { this.far = Math.min(Math.max(this.far * by, 1), this.fitted * 4); this.paint(); }
  rotate(turn, tilt) { this.turn += turn; this.tilt = Math.min(Math.max(this.tilt + tilt, 0.05), 1.55); this.paint(); }
  slide(dx, dy) { const k = this.far * 0.0015, c = Math.cos(this.turn), s = Math.sin(this.turn); this.middle[0] += (s * dx - c * dy) * k * -1; this.middle[1] += (-c * dx - s * dy) * k * -1; this.paint(); }
  mark(chosen, only) { this.chosen = chosen; this.only = only; this.paint(); }
  walk(goal) { this.goal = goal; this.paint(); }
  camera() {
    const { turn, tilt, far, middle: m } = this, back = [Math.cos(tilt) * Math.cos(turn), Math.cos(tilt) * Math.sin(turn), Math.sin(tilt)];
    const right = [-Math.sin(turn), Math.cos(turn), 0], up = [back[1] * right[2] - back[2] * right[1], back[2] * right[0] - back[0] * right[2], back[0] * right[1] - back[1] * right[0]];
    return { eye: m.map((v, i) => v + back[i] * far), right, up, back };
  }
  matrix() { // column-major: perspective * look-at
    const { eye, right, up, back } = this.camera(), f = 1 / Math.tan(0.42), aspect = this.canvas.width / this.canvas.height || 1, near = 0.05, far = this.far * 4 + 20, dot = (a) => a[0] * eye[0] + a[1] * eye[1] + a[2] * eye[2];
    const a = (far + near) / (near - far), b = (2 * far * near) / (near - far); this.lens = -b;
    const fx = f / Math.max(aspect, 1), fy = fx * aspect;
    const rows = [[...right, -dot(right)].map((v) => v * fx), [...up, -dot(up)].map((v) => v * fy), [...back, -dot(back)].map((v, i) => v * a + (i === 3 ? b : 0)), [...back, -dot(back)].map((v) => -v)];
    return new Float32Array([0, 1, 2, 3].flatMap((c) => rows.map((r) => r[c])));
  }
  patches(grid) { // equal cells as few rectangles: column, row, how many across and down, kind
    if (this.patched && this.patched.grid === grid) return this.patched.list;
    const { rows, cols } = grid, cells = expand(grid.cells, rows * cols), heights = expand(grid.heights, rows * cols), list = [];
    const code = cells.map((v, i) => (v === 0 ? 0 : v % 3 === 2 && heights[i] * grid.step > WALL_M ? 2 : 1)), done = new Uint8Array(rows * cols);
    for (let r = 0; r < rows; r++) for (let c = 0; c < cols; c++) {
      const i = r * cols + c, kind = code[i];
      if (!kind || done[i]) continue;
      let across = 1, down = 1;
      while (c + across < cols && code[i + across] === kind && !done[i + across]) across++;
      const same = (row) => { for (let k = 0; k < across; k++) if (code[row * cols + c + k] !== kind || done[row * cols + c + k]) return false; return true; };
      while (r + down < rows && same(r + down)) down++;
      for (let k = 0; k < down; k++) done.fill(1, (r + k) * cols + c, (r + k) * cols + c + across);
      list.push([c, r, across, down, kind]);
    }
    this.patched = { grid, list };
    return list;
  }
  project(point, m = this.matrix()) { const p = [...point, 1], out = [0, 1, 2, 3].map((r) => p.reduce((sum, v, c) => sum + m[c * 4 + r] * v, 0)), box = this.canvas.getBoundingClientRect(); return [box.left + (out[0] / out[3] + 1) / 2 * box.width, box.top + (1 - out[1] / out[3]) / 2 * box.height]; }
  seen(t) { return t.confirmed || this.tentative || t.id === this.chosen || (this.only !== null && this.only.has(t.id)); }
  surface(e) { // the nearest drawn point under the pointer, null without one
    const box = this.canvas.getBoundingClientRect(), m = this.matrix(), { places, wides, count, low, step } = this.cloud, x = (e.clientX - box.left) / box.width * 2 - 1, y = 1 - (e.clientY - box.top) / box.height * 2, scale = Math.hypot(m[1], m[5], m[9]);
    let found = null, nearest = Infinity;
    for (let k = 0; k < count; k++) {
      const a = low[0] + places[3 * k] * step, b = low[1] + places[3 * k + 1] * step, c = low[2] + places[3 * k + 2] * step, w = m[3] * a + m[7] * b + m[11] * c + m[15];
      if (w <= 0 || w >= nearest) continue;
      const reach = Math.max(wides[k] * step * scale / 2, 2 * w * 2 / box.height), dx = (m[0] * a + m[4] * b + m[8] * c + m[12] - x * w) * box.width / box.height, dy = m[1] * a + m[5] * b + m[9] * c + m[13] - y * w;
      if (dx * dx + dy * dy <= reach * reach) { nearest = w; found = [a, b, c]; }
    }
    return found;
  }
  // The smallest box that holds the surface under the pointer; without points, or where a box stands free before the surface, the
  // smallest of the boxes that the ray meets first. A tentative object is found only where there is no confirmed one.
  under(e) {
    if (!this.data || !this.gl) return null;
    const box = this.canvas.getBoundingClientRect(), { eye, right, up, back } = this.camera(), f = 1 / Math.tan(0.42), aspect = box.width / box.height, fx = f / Math.max(aspect, 1), fy = fx * aspect;
    const u = ((e.clientX - box.left) / box.width * 2 - 1) / fx, v = (1 - (e.clientY - box.top) / box.height * 2) / fy, way = [0, 1, 2].map((i) => right[i] * u + up[i] * v - back[i]);
    const point = this.cloud && this.shown ? this.surface(e) : null, limit = point ? point.reduce((sum, p, i) => sum - (p - eye[i]) * back[i], 0) + 0.05 : Infinity;
    const volume = (t) => t.high.reduce((product, h, i) => product * Math.max(h - t.low[i], 0.02), 1), smallest = (list) => list.sort((a, b) => volume(a) - volume(b))[0];
    for (const sure of [true, false]) {
      const here = this.data.objects.filter((t) => t.confirmed === sure && this.seen(t));
      const holding = point ? here.filter((t) => point.every((p, i) => p > t.low[i] - 0.03 && p < t.high[i] + 0.03)) : [];
      if (holding.length) return smallest(holding);
      const met = here.map((t) => {
        let from = 0, to = Infinity;
        for (let i = 0; i < 3; i++) { const p = (t.low[i] - 0.02 - eye[i]) / way[i], q = (t.high[i] + 0.02 - eye[i]) / way[i]; from = Math.max(from, Math.min(p, q)); to = Math.min(to, Math.max(p, q)); }
        return { t, from, hit: from <= to && from < limit };
      }).filter((m) => m.hit), first = Math.min(...met.map((m) => m.from));
      if (met.length) return smallest(met.filter((m) => point || m.from < first + 0.03).map((m) => m.t));
    }
    return null;
  }
  name() { // the names of the chosen object, of named and of large ones, where they do not overlap
    const frame = this.canvas.getBoundingClientRect(), labels = new Labels(frame.width, frame.height), m = this.matrix(), rank = (t) => (t.id === this.chosen ? 1e9 : 0) + (t.names.length ? 1e6 : 0) + footprint(t) - (t.confirmed ? 0 : 1e3);
    if (!frame.width) return;
    for (const t of this.data.objects.filter((o) => this.seen(o) && !(this.only && !this.only.has(o.id) && o.id !== this.chosen)).sort((a, b) => rank(b) - rank(a))) {
      const ends = [t.low, t.high], corners = [0, 1, 2, 3, 4, 5, 6, 7].map((k) => this.project([0, 1, 2].map((i) => ends[k >> i & 1][i]), m)), wide = Math.max(...corners.map((c) => c[0])) - Math.min(...corners.map((c) => c[0]));
      const [x, y] = this.project([(t.low[0] + t.high[0]) / 2, (t.low[1] + t.high[1]) / 2, t.high[2]], m).map((v, i) => v - [frame.left, frame.top][i]), chosen = t.id === this.chosen;
      if (chosen || wide > 34) labels.put(`${called(t)}${t.confirmed ? "" : " ?"}`, chosen ? 13 : 11, [[x, y - 8], [x, y + 6], [x, y - 20]], { bold: chosen, force: chosen, kind: chosen ? "named" : t.confirmed ? "" : "unsure" });
    }
    this.names.replaceChildren(...labels.placed.map(({ text, size, kind, x, y }) => shape("text", { x, y: y + size * 0.35, "font-size": size, "stroke-width": 3, class: kind }, text)));
  }
  paint() {
    if (!this.data || this.canvas.hidden || !this.start()) return;
    const gl = this.gl, ratio = Math.min(window.devicePixelRatio || 1, 2), rgb = (name) => this.css(name).match(/\w\w/g).map((h) => parseInt(h, 16) / 255), put = (list, low, high, colour, alpha = 1) => list.push(...low, high[0] - low[0], high[1] - low[1], high[2] - low[2], ...colour, alpha);
    this.canvas.width = Math.max(1, Math.round(this.canvas.clientWidth * ratio)); this.canvas.height = Math.max(1, Math.round(this.canvas.clientHeight * ratio));
    const solid = [], clear = [], grid = this.data.grid, dots = this.cloud && this.shown;
    if (grid) for (const [c, r, across, down, kind] of this.patches(grid)) { // walls are cut, so that the rooms are visible
      const s = grid.side, low = [grid.origin[0] + c * s, grid.origin[1] + r * s], high = [low[0] + across * s, low[1] + down * s];
      put(solid, [...low, dots ? -0.05 : -0.002], [...high, dots ? -0.048 : 0], rgb("--floor")); // below the points of the floor
      if (kind === 2 && !dots) put(solid, [...low, 0], [...high, CUT_M], rgb("--solid"));
    }
    for (const t of this.data.objects) {
      const chosen = t.id === this.chosen, dim = this.only && !this.only.has(t.id) && !chosen;
      if (!this.seen(t)) continue;
      if (!t.confirmed && !chosen) { for (const [low, high] of edges(t, 0.004)) put(solid, low, high, rgb("--unsure")); continue; } // never solid: nothing confirmed is hidden
      const hex = colourOf(t), colour = chosen ? rgb("--chosen") : hex.match(/\w\w/g).map((h) => parseInt(h, 16) / 255);
      if (!dots || chosen) put(dim || dots ? clear : solid, t.low, t.high, colour, dim ? 0.12 : dots ? 0.35 : 1);
      if (dots && !dim) for (const [low, high] of edges(t, chosen || this.only ? 0.012 : 0.006)) put(solid, low, high, this.only ? rgb("--chosen") : colour);
    }
    if (this.goal && this.goal.path) {
      const way = rgb("--way"), path = this.goal.path;
      for (let k = 0; k + 1 < path.length; k++) { const n = Math.max(1, Math.ceil(Math.hypot(path[k + 1][0] - path[k][0], path[k + 1][1] - path[k][1]) / 0.05)); for (let j = 0; j <= n; j++) { const x = path[k][0] + (path[k + 1][0] - path[k][0]) * j / n, y = path[k][1] + (path[k + 1][1] - path[k][1]) * j / n; put(solid, [x - 0.03, y - 0.03, 0], [x + 0.03, y + 0.03, 0.03], way); } }
      put(solid, [this.goal.x - 0.12, this.goal.y - 0.12, 0], [this.goal.x + 0.12, this.goal.y + 0.12, 0.35], way);
    }
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
    gl.clearColor(...rgb("--unknown"), 1); gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const view = this.matrix();
    if (dots) {
      gl.useProgram(this.dots); gl.bindVertexArray(this.dotsArray);
      gl.uniformMatrix4fv(this.dotsWhere.view, false, view); gl.uniform3f(this.dotsWhere.low, ...this.cloud.low); gl.uniform1f(this.dotsWhere.step_m, this.cloud.step);
      gl.uniform1f(this.dotsWhere.pixels, this.canvas.height / 2 * Math.hypot(view[1], view[5], view[9])); gl.uniform1f(this.dotsWhere.lens, this.lens);
      gl.drawArrays(gl.POINTS, 0, this.cloud.count);
      if (this.floor) {
        gl.useProgram(this.ground); gl.bindVertexArray(this.groundArray); gl.bindTexture(gl.TEXTURE_2D, this.picture);
        gl.uniformMatrix4fv(this.groundWhere.view, false, view); gl.uniform4f(this.groundWhere.area, ...this.floor);
        gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
      }
      gl.bindVertexArray(null);
    }
    gl.useProgram(this.program);
    gl.uniformMatrix4fv(this.where.view, false, view); gl.uniform3f(this.where.sun, 0.35, -0.25, 0.9);
    for (const [list, write] of [[solid, true], [clear, false]]) {
      gl.depthMask(write); gl.bindBuffer(gl.ARRAY_BUFFER, this.boxes); gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(list), gl.DYNAMIC_DRAW);
      gl.drawArraysInstanced(gl.TRIANGLES, 0, 36, list.length / 10);
    }
    gl.depthMask(true);
    this.name();
  }
}
