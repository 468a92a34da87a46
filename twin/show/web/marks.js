"use strict";
// Marks: words, scale bar and compass, drawn flat over a picture.

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

// 1, 2 or 5 times a power of ten.
function niceStep(rough) {
  const power = 10 ** Math.floor(Math.log10(rough));
  return [1, 2, 5, 10].map(m => m * power).reduce(
    (best, one) => Math.abs(Math.log(one / rough)) < Math.abs(Math.log(best / rough)) ? one : best);
}

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
