"use strict";
// Record: the packed mission as numbers, and what it says of any time.

const RADIANS = Math.PI / 180;
const SHALLOW = 3, DIVED = 8;                          // m; between them is no surfacing and no dive
const clamp = (x, low, high) => Math.min(Math.max(x, low), high);
const wrapped = angle => ((angle + 180) % 360 + 360) % 360 - 180;  // [degree]

// A packed array as numbers: offset + step * whole; the least whole number stands for "unknown".
function unpack({ type, offset, step, data }) {
  const text = atob(data), bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  const whole = new { int8: Int8Array, int16: Int16Array, int32: Int32Array }[type](bytes.buffer);
  const none = { int8: -128, int16: -32768, int32: -2147483648 }[type];
  return Float64Array.from(whole, w => w === none ? NaN : offset + step * w);
}

const unpackAll = packed => Object.fromEntries(
  Object.entries(packed).map(([name, one]) => [name, unpack(one)]));

// Index of the sample at or before a time and the part of the way to the next, 0 to 1.
function locate(times, t) {
  let low = 0, high = times.length - 1;
  if (t >= times[high]) return [high - 1, 1];
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (times[middle] <= t) low = middle; else high = middle;
  }
  return [low, Math.max(0, (t - times[low]) / (times[low + 1] - times[low]))];
}

function between(values, [k, part]) {
  if (part === 0) return values[k];
  return part === 1 ? values[k + 1] : values[k] + part * (values[k + 1] - values[k]);
}

class Recording {
  constructor(mission) {
    this.mission = mission;
    this.channels = unpackAll(mission.channels);
    this.prepare();
  }

  prepare() {
    this.times = this.channels.time;
    this.spun = {};
    for (const { name, kind } of this.mission.parts) {
      if (kind !== "spins") continue;
      const rate = this.channels[name], turned = this.spun[name] = new Float64Array(rate.length);
      for (let i = 1; i < rate.length; i++) {
        turned[i] = turned[i - 1]
          + (this.times[i] - this.times[i - 1]) * (rate[i] + rate[i - 1]) / 2;
      }
    }
    this.findSurfacings();
  }

  // Times [s] at which the vehicle comes up after a dive, and the largest depth [m].
  findSurfacings() {
    const { depth } = this.channels;
    let down = false;
    this.surfacings = [];
    this.deepest = this.mission.live ? this.mission.live.depth : 1;
    for (let i = 0; i < depth.length; i++) {
      if (depth[i] > this.deepest) this.deepest = depth[i];
      if (depth[i] > DIVED) down = true;
      else if (down && depth[i] < SHALLOW) {
        down = false;
        this.surfacings.push(this.times[i]);
      }
    }
  }

  get first() { return this.times[0]; }

  get last() { return this.times[this.times.length - 1]; }

  // Of the time line: a live mission has not come there yet.
  get end() { return this.mission.live ? this.mission.live.end : this.last; }

  // More samples, packed as the first ones were.
  append(packed) {
    const more = unpackAll(packed);
    for (const [name, values] of Object.entries(this.channels)) {
      const both = new Float64Array(values.length + more[name].length);
      both.set(values);
      both.set(more[name], values.length);
      this.channels[name] = both;
    }
    this.prepare();
  }

  // Every channel at a time [s]; straight lines between samples, headings the short way round.
  at(t) {
    const where = locate(this.times, t), [k, part] = where, now = { where, time: t };
    for (const [name, values] of Object.entries(this.channels)) {
      if (name !== "time" && name !== "colour") now[name] = between(values, where);
    }
    const { heading } = this.channels;
    if (part > 0) {
      now.heading = heading[k] + part * wrapped(heading[Math.min(k + 1, heading.length - 1)] - heading[k]);
    }
    now.heading = (now.heading % 360 + 360) % 360;
    now.angles = Object.fromEntries(this.mission.parts.map(({ name, kind }) => [
      name, kind === "spins" ? between(this.spun[name], where) : now[name]]));
    now.turn = this.attitude(where);
    return now;
  }

  attitude([k, part]) {
    const { roll, pitch, heading } = this.channels;
    const one = i => Turn.fromEuler(roll[i] * RADIANS, pitch[i] * RADIANS, heading[i] * RADIANS);
    const a = one(k), b = one(Math.min(k + 1, roll.length - 1));
    const sign = a.reduce((sum, x, i) => sum + x * b[i], 0) < 0 ? -1 : 1;
    const q = a.map((x, i) => (1 - part) * x + part * sign * b[i]), long = Math.hypot(...q);
    return q.map(x => x / long);
  }
}
