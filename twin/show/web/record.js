"use strict";
// Record: the packed mission as numbers, what it says of any time, and readouts of it in words.

const RADIANS = Math.PI / 180;
const SHALLOW = 3, DIVED = 8;                          // m; between them is no surfacing and no dive
const clamp = (x, low, high) => Math.min(Math.max(x, low), high);
const wrapped = angle => ((angle + 180) % 360 + 360) % 360 - 180;  // [degree]

// A packed array as numbers: offset + step * whole; the least whole number stands for "unknown".
function unpack({ type, offset, step, data }) {
  const text = atob(data), bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  const [Kind, none] = { int8: [Int8Array, -128], int16: [Int16Array, -32768], int32: [Int32Array, -(2 ** 31)] }[type];
  return Float64Array.from(new Kind(bytes.buffer), w => w === none ? NaN : offset + step * w);
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
        turned[i] = turned[i - 1] + (this.times[i] - this.times[i - 1]) * (rate[i] + rate[i - 1]) / 2;
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

  get last() { return this.times.at(-1); }

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

const UNKNOWN = "–", MINUS = "−";
const MONTHS = ["Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec"];
const DAY = 86400;
const TIME_STEPS = [1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 10800, 21600, 43200,
  ...[1, 2, 5, 10, 20, 50, 100, 200, 500, 1000].map(days => days * DAY)];  // [s]

function plain(value, digits) {
  const text = value.toFixed(digits);
  return Number(text) === 0 ? text.replace("-", "") : text.replace("-", MINUS);
}

const signed = (value, digits) => (Number(value.toFixed(digits)) > 0 ? "+" : "") + plain(value, digits);
const metres = value => value >= 2000 ? `${+(value / 1000).toPrecision(4)} km` : `${+value.toPrecision(4)} m`;
const bearingOf = (north, east) => (Math.atan2(east, north) / RADIANS + 360) % 360;
const three = degrees => String(Math.round(degrees) % 360).padStart(3, "0");
const two = x => String(x).padStart(2, "0");

function clock(seconds) {
  const whole = Math.round(seconds);
  return `${Math.floor(whole / 3600)}:${two(Math.floor(whole / 60) % 60)}:${two(whole % 60)}`;
}

const moment = unix => new Date(1000 * unix).toISOString().replace("T", " ").slice(0, 19);

function buoyancy(mass) {
  if (Math.abs(mass) < 0.005) return "neutral";
  return `${mass >= 0 ? "▼" : "▲"} ${Math.abs(mass).toFixed(2)} kg`;
}

// Times [s] of round clock times, at most so many, and their words: of the day where the date is
// known, else since the mission's start.
function timeTicks([first, last], unix, most) {
  const step = TIME_STEPS.find(one => (last - first) / one <= most) ?? TIME_STEPS.at(-1), zero = unix ?? 0;
  const ticks = [];
  for (let k = Math.ceil((first + zero) / step); k * step <= last + zero; k++) {
    ticks.push([k * step - zero, (unix === null ? sinceStart : ofDay)(k * step, step)]);
  }
  return ticks;
}

function ofDay(unix, step) {
  const date = new Date(1000 * unix).toISOString();
  if (unix % DAY === 0) return `${+date.slice(8, 10)} ${MONTHS[+date.slice(5, 7) - 1]}`;
  return date.slice(11, step < 60 ? 19 : 16);
}

function sinceStart(time, step) {
  if (step >= DAY) return `${time / DAY} d`;
  return step < 60 ? clock(time) : clock(time).slice(0, -3);
}

// Latitude and longitude [degree] of a place [m] north and east of the start, as twin.geodesy has
// it: of the plane that touches the Earth there, or along meridian and parallel.
function geographic(place, north, east) {
  const { latitude, longitude, meridian, normal, convergence } = place;
  if (convergence === null) {
    const turned = north / meridian / RADIANS, middle = (latitude + turned / 2) * RADIANS;
    return [latitude + turned, longitude + east / (normal * Math.cos(middle)) / RADIANS];
  }
  const along = north - 0.5 * convergence * east ** 2, across = east * (1 + north * convergence);
  return [latitude + along / meridian / RADIANS,
    longitude + across / (normal * Math.cos(latitude * RADIANS)) / RADIANS];
}

// Degrees and minutes, as pilots and GPS receivers write them.
function degrees(value, [plus, minus]) {
  const minutes = Math.round(Math.abs(value) * 60000);
  return `${Math.floor(minutes / 60000)}° ${((minutes % 60000) / 1000).toFixed(3)}′ ${value < 0 ? minus : plus}`;
}

function position(place, north, east) {
  const [latitude, longitude] = geographic(place, north, east);
  return `${degrees(latitude, "NS")}, ${degrees(wrapped(longitude), "EW")}`;
}

// Name, explanation, the channels it needs, and its text; an angle that is only drawn has none.
function readouts({ mission, channels }) {
  const speed = v => `${plain(v, 2)} m/s`;
  const list = [
    ["depth", "depth below the surface", ["depth"], now => `${plain(now.depth, 1)} m`],
    ["pitch", "bow up is positive", ["pitch"], now => `${signed(now.pitch, 1)}°`],
    ["roll", "starboard down is positive", ["roll"], now => `${signed(now.roll, 1)}°`],
    ["heading", "true heading of the bow", ["heading"], now => `${three(now.heading)}°`],
    ["surge", "speed forward through the water", ["surge"], now => speed(now.surge)],
    ["speed", "speed through the water", ["speed"], now => speed(now.speed)],
    ["over ground", "horizontal speed over ground", ["ground_speed"], now => speed(now.ground_speed)],
    ["net buoyancy", "▼ heavy, ▲ light", ["net_mass"], now => buoyancy(now.net_mass)],
    ["pumped", "volume that the pump displaces", ["pumped"], now => `${signed(now.pumped, 0)} cm³`],
    ["current", "speed of the current and where it goes", ["current_north", "current_east"],
      now => `${speed(Math.hypot(now.current_north, now.current_east))} → `
        + `${three(bearingOf(now.current_north, now.current_east))}°`],
    ["altitude", "height above the sea floor", ["bottom"], now => `${plain(now.bottom - now.depth, 1)} m`],
  ];
  for (const { name, kind } of mission.parts) {
    const title = name.replaceAll("_", " ");
    const words = {
      spins: now => `${plain(now[name], 0)} rad/s`,
      turns: now => `${signed(now[name] / RADIANS, 1)}°`,
      slides: now => `${signed(1000 * now[name], 0)} mm`,
    }[kind];
    list.push([title, `position of the ${title}`, [name], words]);
  }
  if (mission.unix !== null) {
    list.unshift(["date, UTC", "", ["time"], now => moment(mission.unix + now.time)]);
  }
  if (mission.place !== null) {
    list.push(["position", "latitude and longitude, WGS84", ["north", "east"],
      now => position(mission.place, now.north, now.east)]);
  }
  return list.filter(([, , needed]) => needed.every(
    name => name in channels && !mission.unknown.includes(name)));
}
