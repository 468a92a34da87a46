"use strict";
// Marks: what is drawn flat: words, scale bar and compass over a picture, labels of a scene, and
// without WebGL2 the tracks from above.

// A canvas as many pixels wide as the screen shows, or a share of them; its context counts in CSS
// pixels.
function fitCanvas(canvas, finest = 2, share = 1) {
  const ratio = share * Math.min(devicePixelRatio || 1, finest), { clientWidth: wide, clientHeight: high } = canvas;
  if (canvas.width !== Math.round(wide * ratio) || canvas.height !== Math.round(high * ratio)) {
    canvas.width = Math.max(1, Math.round(wide * ratio));
    canvas.height = Math.max(1, Math.round(high * ratio));
  }
  return { wide, high, ratio };
}

const css = colour => `rgb(${colour.map(c => Math.round(255 * c)).join(" ")})`;

// The one of some numbers that is nearest to one in proportion.
const nearest = (numbers, wanted) => numbers.reduce(
  (best, one) => Math.abs(Math.log(one / wanted)) < Math.abs(Math.log(best / wanted)) ? one : best);

// 1, 2 or 5 times a power of ten.
const niceStep = rough => nearest([1, 2, 5, 10].map(m => m * 10 ** Math.floor(Math.log10(rough))), rough);

function text(context, words, x, y, align = "left", font = "13px") {
  context.font = `${font} system-ui, "DejaVu Sans", sans-serif`;
  context.textAlign = align;
  context.lineWidth = 3;
  context.lineJoin = "round";
  context.strokeStyle = "#06101ccc";
  context.strokeText(words, x, y);
  context.fillStyle = "#fff";
  context.fillText(words, x, y);
}

// A line through points, or with a colour to fill them with, a figure.
function draw(context, points, fill = null) {
  context.beginPath();
  for (const point of points) context.lineTo(...point);
  if (fill) {
    context.fillStyle = fill;
    context.fill();
  } else context.stroke();
}

function drawDot(context, x, y, radius, fill, rim) {
  context.beginPath();
  context.arc(x, y, radius, 0, 7);
  context.fillStyle = fill;
  context.fill();
  context.strokeStyle = rim;
  context.lineWidth = 1.5;
  context.stroke();
}

// What covers the picture: below the title, and above the buttons.
const clearTop = () => $("head").offsetHeight + 20;
const clearBottom = () => $("cameras").offsetHeight + 16;

function drawScaleBar(context, pixelsPerMetre, wide, high) {
  const long = niceStep(110 / pixelsPerMetre), px = long * pixelsPerMetre;
  const x = wide - 24 - px, y = high - clearBottom() - 10;
  context.strokeStyle = "#fff";
  context.lineWidth = 2;
  draw(context, [[x, y - 5], [x, y], [x + px, y], [x + px, y - 5]]);
  text(context, metres(long), x + px / 2, y - 9, "center");
}

// A needle towards north; `angle` is its direction in the picture.
function drawCompass(context, angle, wide, high) {
  context.save();
  context.translate(44, wide < 640 ? clearTop() + 30 : high - clearBottom() - 36);
  context.strokeStyle = "#cfe4f0";
  context.lineWidth = 1.2;
  context.beginPath();
  context.arc(0, 0, 19, 0, 7);
  context.stroke();
  context.save();
  context.rotate(angle);
  draw(context, [[15, 0], [0, 5], [0, -5]], "#ff6b4a");
  draw(context, [[-15, 0], [0, 5], [0, -5]], "#ffffff");
  context.restore();
  text(context, "N", 28 * Math.cos(angle), 28 * Math.sin(angle) + 4, "center", "bold 13px");
  context.restore();
}

// Lines of equal distance north and east of the start; `at` is a place (north, east) in pixels, and
// `middle` what is there in the picture's middle.
function drawGrid(context, at, middle, pixelsPerMetre, wide, high) {
  const step = niceStep(130 / pixelsPerMetre);
  const narrow = wide < 640, [top, bottom] = [clearTop() + (narrow ? 74 : 14), high - clearBottom() - 6];
  const around = (centre, half) => {
    const found = [];
    for (let k = Math.ceil((centre - half) / step); k * step <= centre + half; k++) found.push(k * step);
    return found;
  };
  const norths = around(middle[0], high / 2 / pixelsPerMetre), easts = around(middle[1], wide / 2 / pixelsPerMetre);
  context.strokeStyle = "#ffffff2e";
  context.lineWidth = 1;
  const rows = norths.map(north => [north, at(north, 0)[1]]), columns = easts.map(east => [east, at(0, east)[0]]);
  context.beginPath();
  for (const [, y] of rows) { context.moveTo(0, y); context.lineTo(wide, y); }
  for (const [, x] of columns) { context.moveTo(x, 0); context.lineTo(x, high); }
  context.stroke();
  const [unit, long] = step >= 500 ? ["km", 1000] : ["m", 1];
  const named = (value, plus, minus) => value === 0 ? "0"
    : `${+(Math.abs(value) / long).toPrecision(6)} ${unit} ${value > 0 ? plus : minus}`;
  for (const [north, y] of rows) {
    if (y > top && y < bottom - (narrow ? 24 : 64)) text(context, named(north, "N", "S"), 8, y - 4, "left", "12px");
  }
  for (const [east, x] of columns) {
    if (x > (narrow ? 30 : 96) && x < wide - 200) text(context, named(east, "E", "W"), x, bottom, "center", "12px");
  }
}

function drawLabels(scene, state, size) {
  const { marks, camera, name } = scene, { wide, high, ratio } = fitCanvas(marks);
  const context = marks.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, wide, high);
  const at = place => {
    const [x, y, along] = camera.project(place);
    return along > 0 ? [(x + 1) * wide / 2, (1 - y) * high / 2] : null;
  };
  const put = (place, words, dx, dy, align) => {
    const spot = at(place);
    if (spot) text(context, words, spot[0] + dx, spot[1] + dy, align);
  };
  if (name === "map") {
    drawGrid(context, (north, east) => at([north, -east, 0]), [camera.focus[0], -camera.focus[1]],
      1 / scene.metresPerPixel, wide, high);
    drawScaleBar(context, 1 / scene.metresPerPixel, wide, high);
  } else if (name === "chase") {
    for (const [d, place] of scene.withCurrents && scene.currents ? scene.currents.ladder : []) {
      const room = (at(place)?.[0] ?? 0) > 70;           // else on the other side of the arrow
      put(place, `${plain(d, d % 1 ? 1 : 0)} m`, room ? -12 : 24, room ? 4 : 18, room ? "right" : "left");
    }
  } else {
    labelBlock(scene, at, put, wide);
  }
  // Where the vehicle is, also among the lines of a long track; as on the curve.
  const spot = name !== "chase" && size > 1.5 ? at(scene.vehiclePlace(state)) : null;
  if (spot) drawDot(context, ...spot, 4, "#ff963c", "#fff");
  const { right, up } = camera.axes();
  drawCompass(context, Math.atan2(-up[0], right[0]), wide, high);
  writeFacts(scene, size, wide);
}

// Depths at the left edge of the block, distances along its nearer long edge.
function labelBlock(scene, at, put, wide) {
  const { water, camera, stretch } = scene, { low, high } = water.block;
  const corners = water.corners.map(c => scene.stretched(c));
  const tops = corners.slice(0, 4).map(c => at(c)?.[0] ?? Infinity), left = tops.indexOf(Math.min(...tops));
  const spacing = water.levels.map(d => at([corners[left][0], corners[left][1], -d * stretch])?.[1] ?? NaN);
  const every = Math.max(1, Math.ceil(15 / Math.abs(spacing[1] - spacing[0]) || 1));
  for (const d of water.levels.filter((_, k) => (k + 1) % every === 0)) {
    put([corners[left][0], corners[left][1], -d * stretch], metres(d), -8, 4, "right");
  }
  put(corners[left], wide < 640 ? "0 m" : "depth 0 m", -8, 4, "right");
  const eye = camera.eye(), away = y => Vector.length(Vector.sub(
    scene.stretched(water.toWorld((low[0] + high[0]) / 2, y, high[2])), eye));
  const y = away(low[1]) < away(high[1]) ? low[1] : high[1], long = high[0] - low[0];
  const step = niceStep(long / (wide < 640 ? 3 : 5));
  for (let d = 0; d <= long; d += step) {
    put(scene.stretched(water.toWorld(low[0] + d, y, high[2])), d ? metres(d) : "0", 0, 20, "center");
  }
}

function writeFacts(scene, size, wide) {
  const facts = [];
  if (scene.name !== "map" && scene.stretch !== 1) facts.push(`depth × ${+scene.stretch.toPrecision(2)}`);
  if (size > 1.5) facts.push(`vehicle × ${+size.toPrecision(2)}`);
  if (wide >= 640) facts.push(...scene.mission.facts);
  const words = facts.join(" · ");
  if (words === scene.facts) return;
  $("facts").textContent = words;
  scene.facts = words;
}

class FlatMap {
  constructor(canvas, page) {
    this.canvas = canvas;
    this.page = page;
    this.name = "map";
    this.others = page.mission.tracks.map(track => ({
      colour: css(track.colour), north: unpack(track.north), east: unpack(track.east) }));
  }

  draw(state) {
    const { canvas, page } = this, { wide, high, ratio } = fitCanvas(canvas);
    const { north, east } = page.recording.channels, context = canvas.getContext("2d");
    const all = [{ north, east, colour: css(page.mission.scale.colours.at(-8)) }, ...this.others];
    const range = name => all.reduce(([low, high], one) => one[name].reduce(
      ([a, b], v) => [Math.min(a, v), Math.max(b, v)], [low, high]), [Infinity, -Infinity]);
    const [south, farNorth] = range("north"), [west, farEast] = range("east");
    const scale = 0.72 * Math.min(wide / Math.max(farEast - west, 1), high / Math.max(farNorth - south, 1));
    const middle = [(south + farNorth) / 2, (west + farEast) / 2];
    const at = (n, e) => [wide / 2 + (e - middle[1]) * scale, high / 2 - (n - middle[0]) * scale];
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.fillStyle = "#0c2748";
    context.fillRect(0, 0, wide, high);
    drawGrid(context, at, middle, scale, wide, high);
    context.lineWidth = 2.5;
    for (const one of all) {
      context.strokeStyle = one.colour;
      const step = Math.max(1, Math.floor(one.north.length / 8000)), points = [];
      for (let i = 0; i < one.north.length; i += step) points.push(at(one.north[i], one.east[i]));
      draw(context, points);
    }
    const [x, y] = at(state.north, state.east), heading = state.heading * RADIANS;
    context.save();
    context.translate(x, y);
    context.rotate(heading);
    draw(context, [[0, -11], [6, 8], [0, 4], [-6, 8]], "#fff");
    context.restore();
    drawScaleBar(context, scale, wide, high);
    drawCompass(context, -Math.PI / 2, wide, high);
  }
}
