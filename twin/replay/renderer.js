"use strict";
// Renderer: draws a mission with WebGL2, without any library.
//
// World axes: x north, y west, z up, metres; depth is stretched by the vertical exaggeration. The
// eye is always the origin of what the graphics card sees: places are split into a coarse and a
// fine part of 32 bits each, so that a track of 600 km does not shake when the eye is 4 m from it.

const Vector = {
  add: (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]],
  sub: (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]],
  scale: (a, k) => [a[0] * k, a[1] * k, a[2] * k],
  dot: (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2],
  cross: (a, b) => [
    a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]],
  length: a => Math.hypot(a[0], a[1], a[2]),
};

// Quaternions (w, x, y, z), as MuJoCo has them.
const Turn = {
  times: (a, b) => [
    a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
    a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
    a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
    a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0]],
  about: (axis, angle) => {
    const s = Math.sin(angle / 2);
    return [Math.cos(angle / 2), axis[0] * s, axis[1] * s, axis[2] * s];
  },
  apply: (q, v) => {
    const u = [q[1], q[2], q[3]], t = Vector.scale(Vector.cross(u, v), 2);
    return Vector.add(Vector.add(v, Vector.scale(t, q[0])), Vector.cross(u, t));
  },
  // Roll, pitch, heading [rad] of the field (NED, FRD) as a rotation of the z-up hull.
  fromEuler: (roll, pitch, heading) => Turn.times(
    Turn.about([0, 0, 1], -heading), Turn.times(
      Turn.about([0, 1, 0], -pitch), Turn.about([1, 0, 0], roll))),
};

// A camera that looks at `focus` from `distance` along a bearing (from north towards west) and an
// elevation [rad]; parallel ones see `half` metres up and down from the middle.
class Camera {
  constructor() {
    Object.assign(this, {
      focus: [0, 0, 0], bearing: 0, elevation: 0.4, distance: 10, half: Math.tan(0.244),
      parallel: false, near: 0.1, far: 1000, aspect: 1 });
  }

  axes() {
    const c = Math.cos(this.bearing), s = Math.sin(this.bearing);
    const ce = Math.cos(this.elevation), se = Math.sin(this.elevation);
    const forward = [-c * ce, -s * ce, -se], up = [-c * se, -s * se, ce];
    return { forward, up, right: Vector.cross(forward, up) };
  }

  eye() { return Vector.sub(this.focus, Vector.scale(this.axes().forward, this.distance)); }

  // Places relative to the eye to clip space, column by column.
  matrix() {
    const { forward: f, up: u, right: r } = this.axes(), { near: n, far: z } = this;
    const y = 1 / this.half, x = y / this.aspect;
    if (this.parallel) {
      const d = -2 / (z - n), e = -(z + n) / (z - n);
      return new Float32Array([
        x * r[0], y * u[0], -d * f[0], 0, x * r[1], y * u[1], -d * f[1], 0,
        x * r[2], y * u[2], -d * f[2], 0, 0, 0, e, 1]);
    }
    const d = (z + n) / (z - n), e = -2 * z * n / (z - n);
    return new Float32Array([
      x * r[0], y * u[0], d * f[0], f[0], x * r[1], y * u[1], d * f[1], f[1],
      x * r[2], y * u[2], d * f[2], f[2], 0, 0, e, 0]);
  }

  // Picture coordinates of a place: x and y from -1 to 1 (up), and the distance along the view.
  project(place) {
    const { forward, up, right } = this.axes(), p = Vector.sub(place, this.eye());
    const along = Vector.dot(p, forward), by = this.parallel ? 1 : along;
    return [
      Vector.dot(p, right) / (by * this.half * this.aspect), Vector.dot(p, up) / (by * this.half),
      this.parallel ? along + this.distance : along];
  }

  // Move so that all points fill the picture between margins, shares of its half width and height.
  fit(points, margin) {
    const { forward, up, right } = this.axes();
    const wide = this.half * this.aspect * (1 - (margin.left + margin.right) / 2);
    const high = this.half * (1 - (margin.top + margin.bottom) / 2);
    const middle = points.reduce(Vector.add).map(sum => sum / points.length);
    let target = middle, distance = 1;
    for (let round = 0; round < 20; round++) {
      const seen = points.map(p => Vector.sub(p, target)).map(
        p => [Vector.dot(p, right), Vector.dot(p, up), Vector.dot(p, forward)]);
      distance = Math.max(1e-3, ...seen.map(
        ([x, y, z]) => Math.max(Math.abs(x) / wide, Math.abs(y) / high) - z));
      const xs = seen.map(([x, , z]) => x / (distance + z));
      const ys = seen.map(([, y, z]) => y / (distance + z));
      const x = (Math.max(...xs) + Math.min(...xs)) / 2, y = (Math.max(...ys) + Math.min(...ys)) / 2;
      target = Vector.add(target, Vector.add(
        Vector.scale(right, distance * x), Vector.scale(up, distance * y)));
    }
    // The free part's middle is not the picture's where the margins differ.
    const shift = Vector.add(
      Vector.scale(right, distance * this.half * this.aspect * (margin.right - margin.left) / 2),
      Vector.scale(up, distance * this.half * (margin.top - margin.bottom) / 2));
    this.focus = Vector.add(target, shift);
    this.distance = distance;
  }
}

const BACKGROUND = [`#version 300 es
  out vec2 at;
  void main() {
    at = vec2(gl_VertexID == 1 ? 3. : -1., gl_VertexID == 2 ? 3. : -1.);
    gl_Position = vec4(at, 1., 1.);
  }`, `#version 300 es
  precision highp float;
  in vec2 at; out vec4 colour;
  uniform vec3 forward, right, up;      // right and up as long as half the picture at distance 1
  uniform float depth, open;            // of the eye [m]; 1 in open water, 0 round a block
  uniform vec3 surface, deep, top, bottom, horizon, zenith;
  uniform float fade, reach;
  void main() {
    float rise = normalize(forward + at.x * right + at.y * up).z;
    vec3 dark = mix(bottom, top, .5 + .5 * tanh(2.2 * rise));
    float light = exp(-max(depth - reach * rise, 0.) / fade);
    vec3 water = mix(deep, surface, light) * (1. + .25 * max(rise, 0.));
    if (depth < 0. && rise > 0.) water = mix(horizon, zenith, pow(rise, .6));
    colour = vec4(mix(dark, water, open), 1.);
  }`];

const SOLID = [`#version 300 es
  layout(location=0) in vec3 place; layout(location=1) in vec3 normal;
  layout(location=2) in vec4 rgba;
  uniform mat4 clip, model;             // model: to places relative to the eye
  out vec3 n, p; out vec4 c;
  void main() {
    vec4 there = model * vec4(place, 1.);
    p = there.xyz; n = mat3(model) * normal; c = rgba; gl_Position = clip * there;
  }`, `#version 300 es
  precision highp float;
  in vec3 n, p; in vec4 c; out vec4 colour;
  uniform float flatness, murk, shine;  // 1 shows colours as they are; murk [1/m]
  uniform vec3 fog;
  void main() {
    vec3 view = -normalize(p), m = normalize(n);
    if (dot(m, view) < 0.) m = -m;
    float light = .34 + .36 * dot(m, view) + .34 * max(m.z, 0.);
    float gloss = shine * pow(max(dot(m, normalize(view + vec3(0., 0., 1.))), 0.), 40.);
    vec3 lit = mix(c.rgb * light + gloss, c.rgb, flatness);
    colour = vec4(mix(fog, lit, exp(-murk * length(p))), c.a);
  }`];

const LINE = [`#version 300 es
  layout(location=0) in vec4 a; layout(location=1) in vec4 b;        // north, west: coarse, fine
  layout(location=2) in vec4 aa; layout(location=3) in vec4 bb;      // depth, floor, colour, gap
  uniform mat4 clip; uniform vec2 eyeCoarse, eyeFine, size;
  uniform float eyeZ, stretch, lift, wide, part, onFloor;
  uniform int now, future;
  out vec3 edge, spot; out float span, value, gap;
  vec3 at(vec4 h, vec2 d) {
    vec2 q = (h.xy - eyeCoarse) + (h.zw - eyeFine);
    return vec3(q, -stretch * mix(d.x, d.y, onFloor) + lift - eyeZ);
  }
  void main() {
    int i = gl_InstanceID;
    gl_Position = vec4(2., 2., 2., 1.);
    if (future == 0 ? i > now : i < now) return;
    vec3 p = at(a, aa.xy), q = at(b, bb.xy);
    float first = future == 1 && i == now ? part : 0., last = future == 0 && i == now ? part : 1.;
    vec4 u = clip * vec4(mix(p, q, first), 1.), v = clip * vec4(mix(p, q, last), 1.);
    const float NEAR = 1e-3;
    if (u.w < NEAR && v.w < NEAR) return;
    if (u.w < NEAR) u = mix(u, v, (NEAR - u.w) / (v.w - u.w));
    if (v.w < NEAR) v = mix(v, u, (NEAR - v.w) / (u.w - v.w));
    vec2 s = .5 * size * u.xy / u.w, t = .5 * size * v.xy / v.w, d = t - s;
    float l = length(d);
    d = l > 1e-4 ? d / l : vec2(1., 0.);
    bool end = (gl_VertexID & 1) == 1;
    float side = gl_VertexID < 2 ? -.5 : .5;
    vec4 w = end ? v : u;
    w.xy += (vec2(-d.y, d.x) * side + d * (end ? .5 : -.5)) * wide * 2. / size * w.w;
    gl_Position = w;
    // Multiplied by w, and divided again, because these vary over the picture, not over the scene.
    edge = vec3(end ? l + .5 * wide : -.5 * wide, side * wide, 1.) * w.w;
    span = l; value = end ? bb.z : aa.z; gap = max(aa.w, bb.w);
    spot = mix(p, q, end ? last : first);
  }`, `#version 300 es
  precision highp float;
  in vec3 edge, spot; in float span, value, gap; out vec4 colour;
  uniform float wide, byValue, murk, clear; uniform vec3 plain, fog, hull; uniform sampler2D scale;
  void main() {
    vec2 at = edge.xy / edge.z;
    float beyond = max(max(-at.x, at.x - span), 0.), away = length(vec2(beyond, at.y)) / (.5 * wide);
    if (away > 1. || distance(spot, hull) < clear) discard;
    vec3 c = plain;
    if (byValue > .5) c = value < 0. ? vec3(.6) : texture(scale, vec2(value, .5)).rgb;
    if (gap > .5) c = mix(c, vec3(.45, .5, .55), .7);
    c *= 1. - .38 * away * away * byValue;
    float edge1 = clamp((1. - away) * .5 * wide + .25, 0., 1.);
    colour = vec4(mix(fog, c, exp(-murk * length(spot))), edge1);
  }`];

class Renderer {
  // Throws where the browser has no WebGL2.
  constructor(canvas, palette) {
    const gl = canvas.getContext("webgl2", { antialias: true, alpha: false });
    if (!gl) throw new Error("no WebGL2");
    this.gl = gl; this.palette = palette;
    this.background = this.program(BACKGROUND);
    this.solid = this.program(SOLID);
    this.line = this.program(LINE);
    this.empty = gl.createVertexArray();
    this.texture = null;
    gl.enable(gl.DEPTH_TEST);
    gl.polygonOffset(2, 4);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
  }

  program([vertex, fragment]) {
    const gl = this.gl, made = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(made, shader);
    }
    gl.linkProgram(made);
    if (!gl.getProgramParameter(made, gl.LINK_STATUS)) {
      throw new Error(gl.getProgramInfoLog(made) || "the shaders do not link");
    }
    const uniforms = {};
    for (let i = 0; i < gl.getProgramParameter(made, gl.ACTIVE_UNIFORMS); i++) {
      const { name } = gl.getActiveUniform(made, i);
      uniforms[name] = gl.getUniformLocation(made, name);
    }
    return { made, uniforms };
  }

  use(program, values) {
    const gl = this.gl;
    gl.useProgram(program.made);
    for (const [name, value] of Object.entries(values)) {
      const place = program.uniforms[name];
      if (place === undefined) continue;
      if (typeof value === "number") {
        if (name === "now" || name === "future") gl.uniform1i(place, value);
        else gl.uniform1f(place, value);
      } else if (value.length === 2) gl.uniform2fv(place, value);
      else if (value.length === 3) gl.uniform3fv(place, value);
      else gl.uniformMatrix4fv(place, false, value);
    }
  }

  // Triangles: places, normals (3 each) and colours (4 each) of their corners.
  mesh(places, normals, colours) {
    const gl = this.gl, array = gl.createVertexArray();
    gl.bindVertexArray(array);
    [[places, 3], [normals, 3], [colours, 4]].forEach(([values, width], k) => {
      gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ARRAY_BUFFER, Float32Array.from(values), gl.STATIC_DRAW);
      gl.enableVertexAttribArray(k);
      gl.vertexAttribPointer(k, width, gl.FLOAT, false, 0, 0);
    });
    return { array, count: places.length / 3 };
  }

  // A line through points {north, west, depth, floor, colour, gap}, arrays of equal length.
  path(points) {
    const gl = this.gl, n = points.north.length, data = new Float32Array(8 * n);
    for (let i = 0; i < n; i++) {
      const x = points.north[i], y = points.west[i], cx = Math.fround(x), cy = Math.fround(y);
      const colour = points.colour ? points.colour[i] : 0;
      data.set([cx, cy, x - cx, y - cy, points.depth[i], points.floor ? points.floor[i] : 0,
        Number.isNaN(colour) ? -1 : colour, points.gap ? points.gap[i] : 0], 8 * i);
    }
    const array = gl.createVertexArray(), buffer = gl.createBuffer();
    gl.bindVertexArray(array);
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
    [0, 32, 16, 48].forEach((offset, k) => {
      gl.enableVertexAttribArray(k);
      gl.vertexAttribPointer(k, 4, gl.FLOAT, false, 32, offset);
      gl.vertexAttribDivisor(k, 1);
    });
    return { array, buffer, count: n - 1 };
  }

  forget(path) {
    this.gl.deleteVertexArray(path.array);
    this.gl.deleteBuffer(path.buffer);
  }

  // The colour scale: RGB 0 to 1 of equal steps.
  setScale(colours) {
    const gl = this.gl, bytes = new Uint8Array(colours.length * 4);
    colours.forEach((c, i) => bytes.set([...c.map(x => Math.round(255 * x)), 255], 4 * i));
    this.texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    gl.texImage2D(
      gl.TEXTURE_2D, 0, gl.RGBA, colours.length, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
  }

  // Begin a frame: clear, and paint the water behind everything.
  begin(camera, stretch, open) {
    const gl = this.gl, { forward, up, right } = camera.axes(), eye = camera.eye();
    Object.assign(this, { camera, stretch, eye, clip: camera.matrix() });
    const depth = -eye[2] / stretch, colours = this.palette;
    const light = Math.exp(-Math.max(depth, 0) / colours.fade);
    this.fog = colours.deep.map((d, k) => d + (colours.surface[k] - d) * light);
    this.murk = open ? 1 / 55 : 0;
    gl.viewport(0, 0, gl.drawingBufferWidth, gl.drawingBufferHeight);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.disable(gl.DEPTH_TEST);
    this.use(this.background, {
      forward, right: Vector.scale(right, camera.half * camera.aspect * (camera.parallel ? 0 : 1)),
      up: Vector.scale(up, camera.half * (camera.parallel ? 0 : 1)),
      depth, open: open ? 1 : 0, ...colours });
    gl.bindVertexArray(this.empty);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.enable(gl.DEPTH_TEST);
  }

  // A mesh at `place`, turned and `size` times as large; vertically stretched where it is terrain.
  drawMesh(mesh, { place = [0, 0, 0], turn = [1, 0, 0, 0], size = 1, stretched = false,
    flat = 0, shine = 0, blend = false, murk = 1 }) {
    const gl = this.gl, p = Vector.sub(place, this.eye), k = stretched ? this.stretch : 1;
    const axes = [[1, 0, 0], [0, 1, 0], [0, 0, 1]].map(a => Vector.scale(Turn.apply(turn, a), size));
    const model = new Float32Array([
      ...axes[0], 0, ...axes[1], 0, ...Vector.scale(axes[2], k), 0, ...p, 1]);
    this.use(this.solid, {
      clip: this.clip, model, flatness: flat, shine, fog: this.fog, murk: this.murk * murk });
    // Lines on terrain and walls lie before them.
    if (stretched) gl.enable(gl.POLYGON_OFFSET_FILL); else gl.disable(gl.POLYGON_OFFSET_FILL);
    if (blend) { gl.enable(gl.BLEND); gl.depthMask(false); }
    gl.bindVertexArray(mesh.array);
    gl.drawArrays(gl.TRIANGLES, 0, mesh.count);
    if (blend) { gl.disable(gl.BLEND); gl.depthMask(true); }
  }

  // A path up to `now` (a segment and the part of it), or what comes after it; nothing of it within
  // `clear` metres of the hull.
  drawPath(path, { now = path.count, part = 1, future = false, wide = 4, colour = null,
    onFloor = false, lift = 0, hull = this.eye, clear = 0 }) {
    const gl = this.gl, [x, y, z] = this.eye, cx = Math.fround(x), cy = Math.fround(y);
    this.use(this.line, {
      clip: this.clip, eyeCoarse: [cx, cy], eyeFine: [x - cx, y - cy], eyeZ: z,
      size: [gl.drawingBufferWidth, gl.drawingBufferHeight], stretch: this.stretch, lift, wide,
      part, now, future: future ? 1 : 0, onFloor: onFloor ? 1 : 0, byValue: colour ? 0 : 1,
      hull: Vector.sub(hull, this.eye), clear, plain: colour || [1, 1, 1], fog: this.fog, murk: this.murk });
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    gl.enable(gl.SAMPLE_ALPHA_TO_COVERAGE);
    gl.bindVertexArray(path.array);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, path.count);
    gl.disable(gl.SAMPLE_ALPHA_TO_COVERAGE);
  }
}

// Shapes of the scene: corners, normals and colours of triangles, as `Renderer.mesh` takes them.
class Shape {
  constructor() { this.places = []; this.normals = []; this.colours = []; }

  triangle(a, b, c, colour, normals = null) {
    const flat = Vector.cross(Vector.sub(b, a), Vector.sub(c, a));
    const unit = Vector.scale(flat, 1 / (Vector.length(flat) || 1));
    this.places.push(...a, ...b, ...c);
    for (let k = 0; k < 3; k++) this.normals.push(...(normals ? normals[k] : unit));
    const colours = Array.isArray(colour[0]) ? colour : [colour, colour, colour];
    this.colours.push(...colours.flat());
  }

  // Corners in turn; colours one or four.
  quad(a, b, c, d, colour) {
    const [p, q, r, s] = Array.isArray(colour[0]) ? colour : [colour, colour, colour, colour];
    this.triangle(a, b, c, [p, q, r]);
    this.triangle(a, c, d, [p, r, s]);
  }

  // An arrow of length 1 along x.
  static arrow(colour, thin = 0.03) {
    const shape = new Shape(), sides = 12, neck = 0.68, head = 3 * thin;
    for (let k = 0; k < sides; k++) {
      const [s, t] = [k, k + 1].map(j => 2 * Math.PI * j / sides);
      const ring = (x, r, angle) => [x, r * Math.cos(angle), r * Math.sin(angle)];
      const out = angle => [0, Math.cos(angle), Math.sin(angle)];
      const round = [out(s), out(t), out(t), out(s)];
      const shaft = [ring(0, thin, s), ring(0, thin, t), ring(neck, thin, t), ring(neck, thin, s)];
      shape.triangle(shaft[0], shaft[1], shaft[2], colour, [round[0], round[1], round[2]]);
      shape.triangle(shaft[0], shaft[2], shaft[3], colour, [round[0], round[2], round[3]]);
      shape.triangle(ring(neck, head, s), ring(neck, head, t), [1, 0, 0], colour);
      shape.triangle([neck, 0, 0], ring(neck, head, t), ring(neck, head, s), colour);
    }
    return shape;
  }

  upload(renderer) { return renderer.mesh(this.places, this.normals, this.colours); }
}
