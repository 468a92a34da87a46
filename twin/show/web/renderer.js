"use strict";
// Renderer: draws the water behind everything, solid bodies and lines with WebGL2, without a library.
//
// The eye is always the origin of what the graphics card sees: places are split into a coarse and a
// fine part of 32 bits each, so that a track of 600 km does not shake when the eye is 4 m from it.

// Colours are worked out at the corners of a grid, which is enough for what changes so little; where
// the sky is seen, at each pixel, for a sharp horizon.
const GRID = { columns: 16, rows: 32 };
const WATER = `
  uniform vec3 forward, right, up;      // right and up as long as half the picture at distance 1
  uniform float depth, open;            // of the eye [m]; 1 in open water, 0 round a block
  uniform vec3 surface, deep, top, bottom, horizon, zenith;
  uniform float fade, reach;
  vec3 water(vec2 at) {
    float rise = normalize(forward + at.x * right + at.y * up).z;
    vec3 dark = mix(bottom, top, .5 + .5 * tanh(2.2 * rise));
    float light = exp(-max(depth - reach * rise, 0.) / fade);
    vec3 water = mix(deep, surface, light) * (1. + .25 * max(rise, 0.));
    if (depth < 0. && rise > 0.) water = mix(horizon, zenith, pow(rise, .6));
    return mix(dark, water, open);
  }`;
const BACKGROUND = [`#version 300 es
  out vec2 at; out vec3 shade;
  ${WATER}
  void main() {
    int corner = gl_VertexID % 6, cell = gl_VertexID / 6;
    corner = corner < 3 ? corner : 6 - corner;
    ivec2 node = ivec2(cell % ${GRID.columns} + (corner & 1), cell / ${GRID.columns} + (corner >> 1));
    at = 2. * vec2(node) / vec2(${GRID.columns}, ${GRID.rows}) - 1.;
    shade = water(at);
    gl_Position = vec4(at, 1., 1.);
  }`, `#version 300 es
  precision highp float;
  in vec2 at; in vec3 shade; out vec4 colour;
  ${WATER}
  void main() {
    colour = vec4(shade, 1.);
    if (depth < 0. && open > .5) colour.rgb = water(at);
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
  uniform highp sampler2D points;       // two texels a point, see below
  uniform mat4 clip; uniform vec2 eyeCoarse, eyeFine, size;
  uniform float eyeZ, stretch, lift, wide, part, onFloor;
  uniform int start;                    // the first segment that is drawn
  uniform int cut, future;              // the segment that is drawn in part, before or after it
  out vec3 edge, spot; out float span, value, gap;
  vec4 texel(int point, int second) {
    int k = 2 * point + second;
    return texelFetch(points, ivec2(k & 2047, k >> 11), 0);
  }
  vec3 at(vec4 h, vec2 d) {
    vec2 q = (h.xy - eyeCoarse) + (h.zw - eyeFine);
    return vec3(q, -stretch * mix(d.x, d.y, onFloor) + lift - eyeZ);
  }
  void main() {
    int segment = gl_VertexID / 6, corner = gl_VertexID % 6;       // of two triangles
    corner = corner < 3 ? corner : 6 - corner;                     // 0 1 2, 3 2 1
    int from = start + segment;
    vec4 a = texel(from, 0), b = texel(from + 1, 0);               // north, west: coarse, fine
    vec4 aa = texel(from, 1), bb = texel(from + 1, 1);             // depth, floor, colour, gap
    bool here = segment == cut;
    gl_Position = vec4(2., 2., 2., 1.);
    vec3 p = at(a, aa.xy), q = at(b, bb.xy);
    float first = here && future == 1 ? part : 0., last = here && future == 0 ? part : 1.;
    vec4 u = clip * vec4(mix(p, q, first), 1.), v = clip * vec4(mix(p, q, last), 1.);
    const float NEAR = 1e-3;
    if (u.w < NEAR && v.w < NEAR) return;
    if (u.w < NEAR) u = mix(u, v, (NEAR - u.w) / (v.w - u.w));
    if (v.w < NEAR) v = mix(v, u, (NEAR - v.w) / (u.w - v.w));
    vec2 s = .5 * size * u.xy / u.w, t = .5 * size * v.xy / v.w, d = t - s;
    float l = length(d);
    d = l > 1e-4 ? d / l : vec2(1., 0.);
    bool end = (corner & 1) == 1;
    float side = corner < 2 ? -.5 : .5;
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

const POINTS_PER_ROW = 1024;                           // of a path's texture; also in LINE
const WHOLE = new Set(["cut", "future", "start", "points", "scale"]);  // uniforms that are integers

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
        if (WHOLE.has(name)) gl.uniform1i(place, value);
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

  // A line through points {north, west, depth, floor, colour, gap}, arrays of equal length; of
  // `kept` points alone where given.
  path(points, kept = null) {
    const gl = this.gl, n = kept ? kept.length : points.north.length;
    const rows = Math.ceil(n / POINTS_PER_ROW), data = new Float32Array(8 * POINTS_PER_ROW * rows);
    for (let k = 0, to = 0; k < n; k++, to += 8) {
      const i = kept ? kept[k] : k, x = points.north[i], y = points.west[i];
      data[to] = x; data[to + 1] = y;
      data[to + 2] = x - data[to]; data[to + 3] = y - data[to + 1];
      data[to + 4] = points.depth[i];
      data[to + 5] = points.floor ? points.floor[i] : 0;
      data[to + 6] = points.colour ? points.colour[i] : 0;
      data[to + 7] = points.gap ? points.gap[i] : 0;
    }
    const texture = this.texture(1, gl.NEAREST);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, 2 * POINTS_PER_ROW, rows, 0, gl.RGBA, gl.FLOAT, data);
    return { texture, count: n - 1 };
  }

  // A new texture, bound to a unit.
  texture(unit, filter) {
    const gl = this.gl, made = gl.createTexture();
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(gl.TEXTURE_2D, made);
    const look = { MIN_FILTER: filter, MAG_FILTER: filter, WRAP_S: gl.CLAMP_TO_EDGE, WRAP_T: gl.CLAMP_TO_EDGE };
    for (const name in look) gl.texParameteri(gl.TEXTURE_2D, gl[`TEXTURE_${name}`], look[name]);
    return made;
  }

  forget(path) { this.gl.deleteTexture(path.texture); }

  // The colour scale: RGB 0 to 1 of equal steps.
  setScale(colours) {
    const gl = this.gl, bytes = new Uint8Array(colours.length * 4);
    colours.forEach((c, i) => bytes.set([...c.map(x => Math.round(255 * x)), 255], 4 * i));
    this.texture(0, gl.LINEAR);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, colours.length, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
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
    gl.drawArrays(gl.TRIANGLES, 0, 6 * GRID.columns * GRID.rows);
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

  // `count` segments of a path from number `first` on. Of segment `cut`, counted from the first, only
  // the part before `part` is drawn, or after it for the future; nothing within `clear` metres of
  // the hull.
  drawPath(path, { first = 0, count = path.count, cut = -1, part = 1, future = false, wide = 4,
    colour = null, onFloor = false, lift = 0, hull = this.eye, clear = 0 }) {
    const gl = this.gl, [x, y, z] = this.eye, cx = Math.fround(x), cy = Math.fround(y);
    this.use(this.line, {
      clip: this.clip, eyeCoarse: [cx, cy], eyeFine: [x - cx, y - cy], eyeZ: z,
      size: [gl.drawingBufferWidth, gl.drawingBufferHeight], stretch: this.stretch, lift, wide,
      points: 1, scale: 0, part, start: first, cut, future: future ? 1 : 0,
      onFloor: onFloor ? 1 : 0, byValue: colour ? 0 : 1,
      hull: Vector.sub(hull, this.eye), clear, plain: colour || [1, 1, 1], fog: this.fog, murk: this.murk });
    gl.activeTexture(gl.TEXTURE1);
    gl.bindTexture(gl.TEXTURE_2D, path.texture);
    gl.bindVertexArray(this.empty);
    gl.enable(gl.SAMPLE_ALPHA_TO_COVERAGE);
    gl.drawArrays(gl.TRIANGLES, 0, 6 * count);
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
    return this;
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

  upload(renderer) {
    return this.places.length ? renderer.mesh(this.places, this.normals, this.colours) : null;
  }
}
