"use strict";
// Strip: depth against time with its axes, and the moment that is shown.

const GUTTER = 46, RIGHT = 9, AXIS = 17;               // pixels for depths, past the end, for times
const LEAST_SPAN = 10;                                 // s that it is zoomed into at most

class Strip {
  constructor(canvas, page) {
    Object.assign(this, { canvas, page, span: null, still: document.createElement("canvas") });
    this.listen();
  }

  // First and last time that is shown.
  get shown() {
    const { first, end } = this.page.recording;
    return this.span ?? [first, end];
  }

  timeAt(x) {
    const [first, last] = this.shown, wide = this.canvas.clientWidth - GUTTER - RIGHT;
    return first + clamp((x - GUTTER) / wide, 0, 1) * (last - first);
  }

  // A press goes to its moment; the wheel or two fingers show a part of the mission.
  listen() {
    const { canvas, page } = this, across = x => x - canvas.getBoundingClientRect().left;
    const go = event => page.seek(this.timeAt(across(event.clientX)));
    followFingers(canvas, {
      press: go,
      drag: (dx, dy, event) => go(event),
      pinch: (old, now) => this.zoom(Math.max(old.wide, 8) / Math.max(now.wide, 8),
        this.timeAt(across(old.x)), across(now.x)),
      wheel: (longer, { clientX }) => this.zoom(longer, this.timeAt(across(clientX)), across(clientX)),
    });
    canvas.addEventListener("dblclick", () => this.showAll());
  }

  // Show so many times as long a part, with `time` at `x` pixels.
  zoom(factor, time, x) {
    const { first, end } = this.page.recording, [from, to] = this.shown;
    const long = clamp((to - from) * factor, Math.min(LEAST_SPAN, end - first), end - first);
    const share = clamp((x - GUTTER) / (this.canvas.clientWidth - GUTTER - RIGHT), 0, 1);
    const start = clamp(time - share * long, first, end - long);
    this.span = long < 0.999 * (end - first) ? [start, start + long] : null;
    this.forget();
  }

  showAll() {
    this.span = null;
    this.forget();
  }

  // Paint the curve again: it has grown, or looks different.
  forget() {
    this.painted = null;
    this.page.touch();
  }

  draw() {
    const { canvas, page } = this, { wide, high, ratio } = fitCanvas(canvas, 3), { time } = page;
    if (this.span && (time < this.span[0] || time > this.span[1])) {  // as far as it goes, it stays in sight
      const { first, end } = page.recording, long = this.span[1] - this.span[0];
      const start = clamp(time - 0.1 * long, first, end - long);
      this.span = [start, start + long];
      this.painted = null;
    }
    const size = `${wide} ${high} ${ratio}`;
    if (this.painted !== size) this.paint(wide, high, ratio);
    this.painted = size;
    const context = canvas.getContext("2d"), [first, last] = this.shown;
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, canvas.width, canvas.height);
    context.drawImage(this.still, 0, 0);
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    const x = GUTTER + (time - first) / (last - first) * (wide - GUTTER - RIGHT);
    const y = this.depthToPixels(between(page.recording.channels.depth, locate(page.recording.times, time)));
    context.fillStyle = this.ink.ink;
    context.fillRect(x - 0.75, 0, 1.5, high - AXIS);
    drawDot(context, x, y, 5, this.ink.accent, this.ink.ink);
  }

  // All but the moment, which does not change from picture to picture.
  paint(wide, high, ratio) {
    const { still, page } = this, { channels, deepest, times } = page.recording;
    const [first, last] = this.shown, style = getComputedStyle(document.documentElement);
    this.ink = Object.fromEntries(["ink", "dim", "line", "accent", "curve"].map(
      name => [name, style.getPropertyValue(`--${name}`)]));
    [still.width, still.height] = [this.canvas.width, this.canvas.height];
    const context = still.getContext("2d"), [top, bottom] = [6, high - AXIS - 5];
    const x = t => GUTTER + (t - first) / (last - first) * (wide - GUTTER - RIGHT);
    this.depthToPixels = d => top + Math.max(d, 0) / deepest * (bottom - top);
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.font = '11px system-ui, "DejaVu Sans", sans-serif';
    this.paintAxes(context, x, wide, high);
    context.save();
    context.beginPath();
    context.rect(GUTTER, 0, wide - GUTTER - RIGHT, high - AXIS);
    context.clip();
    const from = locate(times, first)[0], to = Math.min(locate(times, last)[0] + 1, times.length - 1);
    if (channels.bottom) {
      context.beginPath();
      context.moveTo(x(times[from]), high);
      const step = Math.max(1, Math.floor((to - from) / wide));
      for (let i = from; i <= to; i += step) context.lineTo(x(times[i]), this.depthToPixels(channels.bottom[i]));
      context.lineTo(x(times[to]), high);
      context.fillStyle = "#8f8266";
      context.fill();
    }
    this.paintCurve(context, x, from, to);
    context.restore();
  }

  // Shallowest and deepest of each pixel: no turn of a dive is left out.
  paintCurve(context, x, from, to) {
    const { depth, time } = this.page.recording.channels;
    context.strokeStyle = this.ink.curve;
    context.lineWidth = 1.3;
    context.lineJoin = "round";
    context.beginPath();
    for (let k = from; k <= to;) {
      const column = Math.floor(x(time[k]));
      let low = k, deep = k, next = k;
      for (; next <= to && Math.floor(x(time[next])) === column; next++) {
        if (depth[next] < depth[low]) low = next;
        if (depth[next] > depth[deep]) deep = next;
      }
      for (const i of [k, Math.min(low, deep), Math.max(low, deep), next - 1]) {
        context.lineTo(x(time[i]), this.depthToPixels(depth[i]));
      }
      k = next;
    }
    context.stroke();
  }

  // Depths in the gutter and times below: beside the curve, never on it.
  paintAxes(context, x, wide, high) {
    const { deepest } = this.page.recording, step = niceStep(deepest / 2.2);
    context.strokeStyle = this.ink.line;
    context.fillStyle = this.ink.dim;
    context.lineWidth = 1;
    context.textBaseline = "middle";
    context.textAlign = "right";
    context.beginPath();
    for (let d = 0; d <= deepest; d += step) {
      const y = Math.round(this.depthToPixels(d)) + 0.5;
      context.moveTo(GUTTER - 4, y);
      context.lineTo(wide - RIGHT, y);
      context.fillText(d ? `${+d.toPrecision(3)} m` : "0", GUTTER - 7, y);
    }
    context.stroke();
    context.textBaseline = "alphabetic";
    context.fillText("depth", GUTTER - 7, high - 2);
    context.textAlign = "center";
    context.beginPath();
    let free = GUTTER;                                 // what is left of it is taken by words
    for (const [t, words] of timeTicks(this.shown, this.page.mission.unix, (wide - GUTTER) / 62)) {
      const half = context.measureText(words).width / 2, at = x(t);
      context.moveTo(at, high - AXIS);
      context.lineTo(at, high - AXIS + 4);
      if (at - half < free || at + half > wide) continue;
      context.fillText(words, at, high - 2);
      free = at + half + 8;
    }
    context.stroke();
  }
}
