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
const POINT_VERTEX = `#version 300 es
in vec3 place; in vec3 tint; uniform mat4 view; uniform vec3 low; uniform float step_m; uniform float width; out vec3 shade;
void main() { gl_Position = view * vec4(low + place * step_m, 1.0); gl_PointSize = clamp(width / gl_Position.w, 1.5, 40.0); shade = tint; }`;
const POINT_FRAGMENT = `#version 300 es
precision mediump float; in vec3 shade; out vec4 drawn; void main() { vec2 off = gl_PointCoord - 0.5; if (dot(off, off) > 0.25) discard; drawn = vec4(shade, 1.0); }`;

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
    this.canvas = canvas; this.on = on; this.turn = -0.9; this.tilt = 0.85; this.far = 10; this.middle = [0, 0, 0.4]; this.chosen = null; this.only = null; this.goal = null; this.cloud = null; this.shown = true;
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
    this.dotsWhere = Object.fromEntries(["view", "low", "step_m", "width"].map((name) => [name, gl.getUniformLocation(dots, name)]));
    this.dotsArray = gl.createVertexArray(); this.places = gl.createBuffer(); this.tints = gl.createBuffer();
    gl.bindVertexArray(this.dotsArray);
    for (const [buffer, name, kind, normal] of [[this.places, "place", gl.UNSIGNED_SHORT, false], [this.tints, "tint", gl.UNSIGNED_BYTE, true]]) { gl.bindBuffer(gl.ARRAY_BUFFER, buffer); const at = gl.getAttribLocation(dots, name); gl.enableVertexAttribArray(at); gl.vertexAttribPointer(at, 3, kind, normal, 0, 0); }
    gl.bindVertexArray(null);
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
      const places = new Uint16Array(3 * kept.length), tints = new Uint8Array(3 * kept.length), all = new Uint16Array(bytes.buffer, 0, 3 * n);
      kept.forEach((from, to) => { for (let i = 0; i < 3; i++) { places[3 * to + i] = all[3 * from + i]; tints[3 * to + i] = bytes[6 * n + 3 * from + i]; } });
      for (const [buffer, values] of [[this.places, places], [this.tints, tints]]) { gl.bindBuffer(gl.ARRAY_BUFFER, buffer); gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW); }
      this.cloud = { ...cloud, points: null, count: kept.length };
    }
    this.paint();
  }
  below(cloud, places) { // the points to draw: all below the cut, and those of confirmed objects above it
    const kept = [], whole = this.data.objects.filter((t) => t.confirmed && t.high[2] > CUT_M);
    for (let k = 0; k < cloud.count; k++) {
      const p = [0, 1, 2].map((i) => cloud.low[i] + places[3 * k + i] * cloud.step);
      if (p[2] <= CUT_M || whole.some((t) => p.every((v, i) => v > t.low[i] - 0.05 && v < t.high[i] + 0.05))) kept.push(k);
    }
    return kept;
  }
  draw(data, css, whole) {
    this.data = data; this.css = css;
    this.middle = [whole.x + whole.w / 2, -(whole.y + whole.h / 2), 0.4];
    this.fitted = this.far = Math.hypot(whole.w, whole.h) * 1.2;
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
    const a = (far + near) / (near - far), b = (2 * far * near) / (near - far), fx = f / Math.max(aspect, 1), fy = fx * aspect;
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
  project(point) { const m = this.matrix(), p = [...point, 1], out = [0, 1, 2, 3].map((r) => p.reduce((sum, v, c) => sum + m[c * 4 + r] * v, 0)), box = this.canvas.getBoundingClientRect(); return [box.left + (out[0] / out[3] + 1) / 2 * box.width, box.top + (1 - out[1] / out[3]) / 2 * box.height]; }
  under(e) { // the nearest box that the ray through the pointer meets
    if (!this.data || !this.gl) return null;
    const box = this.canvas.getBoundingClientRect(), { eye, right, up, back } = this.camera(), f = 1 / Math.tan(0.42), aspect = box.width / box.height, fx = f / Math.max(aspect, 1), fy = fx * aspect;
    const u = ((e.clientX - box.left) / box.width * 2 - 1) / fx, v = (1 - (e.clientY - box.top) / box.height * 2) / fy, way = [0, 1, 2].map((i) => right[i] * u + up[i] * v - back[i]);
    let best = null, nearest = Infinity;
    for (const t of this.data.objects) {
      if (!t.confirmed && t.id !== this.chosen) continue;
      let from = 0, to = Infinity;
      for (let i = 0; i < 3; i++) { const p = (t.low[i] - 0.02 - eye[i]) / way[i], q = (t.high[i] + 0.02 - eye[i]) / way[i]; from = Math.max(from, Math.min(p, q)); to = Math.min(to, Math.max(p, q)); }
      if (from <= to && from < nearest) { nearest = from; best = t; }
    }
    return best;
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
      if (!t.confirmed && !chosen) continue;
      const hex = COLOURS[t.colours[0]] || "#4a78b8", colour = chosen ? rgb("--chosen") : hex.match(/\w\w/g).map((h) => parseInt(h, 16) / 255);
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
      gl.uniform1f(this.dotsWhere.width, this.cloud.width * this.canvas.height / 2 * Math.hypot(view[1], view[5], view[9]));
      gl.drawArrays(gl.POINTS, 0, this.cloud.count);
      gl.bindVertexArray(null);
    }
    gl.useProgram(this.program);
    gl.uniformMatrix4fv(this.where.view, false, view); gl.uniform3f(this.where.sun, 0.35, -0.25, 0.9);
    for (const [list, write] of [[solid, true], [clear, false]]) {
      gl.depthMask(write); gl.bindBuffer(gl.ARRAY_BUFFER, this.boxes); gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(list), gl.DYNAMIC_DRAW);
      gl.drawArraysInstanced(gl.TRIANGLES, 0, 36, list.length / 10);
    }
    gl.depthMask(true);
  }
}
