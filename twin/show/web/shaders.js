"use strict";
// Shaders: the water behind everything, solid bodies, and lines of so many pixels.
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
