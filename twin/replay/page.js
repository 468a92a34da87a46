"use strict";
// Page: reads the mission, moves time, and shows readouts, scene, marks and the depth strip.

const UNKNOWN = "–", MINUS = "−", RADIANS = Math.PI / 180;
const $ = name => document.getElementById(name);
const clamp = (x, low, high) => Math.min(Math.max(x, low), high);
const calm = matchMedia("(prefers-reduced-motion: reduce)").matches;

// --- the record ------------------------------------------------------------------------------

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

const wrapped = angle => ((angle + 180) % 360 + 360) % 360 - 180;  // [degree]

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
    const heading = this.channels.heading;
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

// --- readouts --------------------------------------------------------------------------------

function plain(value, digits) {
  const text = value.toFixed(digits);
  return Number(text) === 0 ? text.replace("-", "") : text.replace("-", MINUS);
}

const signed = (value, digits) => (Number(value.toFixed(digits)) > 0 ? "+" : "") + plain(value, digits);

function clock(seconds) {
  const whole = Math.round(seconds), two = x => String(x).padStart(2, "0");
  return `${Math.floor(whole / 3600)}:${two(Math.floor(whole / 60) % 60)}:${two(whole % 60)}`;
}

function buoyancy(mass) {
  if (Math.abs(mass) < 0.005) return "neutral";
  return `${mass >= 0 ? "▼" : "▲"} ${Math.abs(mass).toFixed(2)} kg`;
}

const bearingOf = (north, east) => (Math.atan2(east, north) / RADIANS + 360) % 360;
const three = degrees => String(Math.round(degrees) % 360).padStart(3, "0");

// Name, explanation, the channels it needs, and its text; an angle that is only drawn has none.
function readouts(recording) {
  const { mission, channels } = recording, speed = v => `${plain(v, 2)} m/s`;
  const moment = now => new Date(1000 * (mission.unix + now.time)).toISOString();
  const list = [
    ["date, UTC", "", ["time"], now => moment(now).replace("T", " ").slice(0, 19)],
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
    const text = {
      spins: now => `${plain(now[name], 0)} rad/s`,
      turns: now => `${signed(now[name] / RADIANS, 1)}°`,
      slides: now => `${signed(1000 * now[name], 0)} mm`,
    }[kind];
    list.push([title, `position of the ${title}`, [name], text]);
  }
  if (mission.unix === null) list.shift();
  return list.filter(([, , needed]) => needed.every(
    name => name in channels && !mission.unknown.includes(name)));
}

// --- the page --------------------------------------------------------------------------------

class Page {
  constructor(mission) {
    this.mission = mission;
    this.recording = new Recording(mission);
    this.items = readouts(this.recording);
    this.time = this.recording.first;
    this.playing = false;
    this.speed = 1;
    this.stale = true;
    this.buildReadouts();
    this.buildTransport();
    this.buildLegend();
    this.buildHelp();
    this.strip = new Strip($("strip"), this);
    try {
      this.scene = new Scene($("scene"), $("marks"), this);
    } catch (error) {
      this.scene = new FlatMap($("marks"), this);
      const alert = $("alert");
      alert.hidden = false;
      alert.textContent = `No three dimensions here (${error.message}): `
        + "the track is shown from above. A browser with WebGL2 shows all.";
    }
    this.buildCameras();
    addEventListener("resize", () => this.touch());
    addEventListener("keydown", event => this.key(event));
    addEventListener("hashchange", () => this.obeyAddress());
    matchMedia("(prefers-color-scheme: light)").addEventListener("change", () => this.touch());
    this.seek(mission.opening.time ?? this.recording.first);
    this.scene.show(mission.opening.camera);
    this.obeyAddress();
    requestAnimationFrame(now => this.frame(now));
  }

  // #t=600&camera=chase&play=1 after the address opens the page at that moment.
  obeyAddress() {
    const words = new URLSearchParams(location.hash.slice(1));
    if (words.has("t") && Number.isFinite(Number(words.get("t")))) this.seek(Number(words.get("t")));
    if (CAMERAS.includes(words.get("camera"))) this.chooseCamera(words.get("camera"));
    if (words.has("play")) this.setPlaying(words.get("play") !== "0");
  }

  touch() { this.stale = true; }

  // A mission that is flown now: ask its server for what came since, twice a second.
  async follow() {
    this.live = { running: true, state: "live" };
    this.setPlaying(true);
    while (this.live.running) {
      try {
        const answer = await fetch(`rows?from=${this.recording.times.length}`);
        const { channels, running, problem } = await answer.json();
        if (channels) {
          this.recording.append(channels);
          this.scene.extend();
          this.touch();
        }
        this.live.running = running;
        this.live.state = problem || (running ? "live" : `of ${clock(this.recording.last)}`);
      } catch {
        this.live = { running: false, state: "the server has ended" };
      }
      this.touch();
      await new Promise(done => setTimeout(done, 500));
    }
  }

  seek(time) {
    this.time = clamp(time, this.recording.first, this.recording.last);
    this.jumped = true;
    this.touch();
  }

  setPlaying(playing) {
    if (playing && this.time >= this.recording.last && !this.live?.running) this.seek(this.recording.first);
    this.playing = playing;
    $("play").textContent = playing ? "Pause" : "Play";
    this.touch();
  }

  frame(now) {
    const elapsed = Math.min((now - (this.before ?? now)) / 1000, 0.25);
    this.before = now;
    if (this.playing) {
      this.time = Math.min(this.time + elapsed * this.speed, this.recording.last);
      if (this.time >= this.recording.last && !this.live?.running) this.setPlaying(false);
      this.touch();
    }
    if (this.stale) {
      this.stale = false;
      const state = this.recording.at(this.time);
      this.scene.draw(state, elapsed, this.jumped);
      this.jumped = false;
      this.strip.draw();
      this.write(state);
    }
    requestAnimationFrame(later => this.frame(later));
  }

  write(state) {
    const unknown = state.gap > 0;
    this.values.time.textContent = clock(this.time);
    for (const [name, , needed, text] of this.items) {
      const known = (!unknown || name.startsWith("date")) && needed.every(one => Number.isFinite(state[one]));
      this.values[name].textContent = known ? text(state) : UNKNOWN;
    }
    const slider = $("slider");
    slider.value = this.time;
    slider.setAttribute("aria-valuetext", `${clock(this.time)}, depth ${plain(state.depth, 1)} metres`);
    $("moment").textContent = this.live ? this.live.state : `of ${clock(this.recording.end)}`;
  }

  buildReadouts() {
    this.values = {};
    const names = [["time", "hours, minutes and seconds since the mission's start"], ...this.items];
    for (const [name, meaning] of names) {
      const box = document.createElement("div"), term = document.createElement("dt");
      const value = this.values[name] = document.createElement("dd");
      term.textContent = name;
      value.dataset.name = name;
      box.title = meaning;
      if (name === "current" || name.startsWith("date")) box.className = "wide";
      box.append(term, value);
      $("readouts").append(box);
    }
  }

  buildTransport() {
    const { first, end } = this.recording, slider = $("slider");
    slider.min = first;
    slider.max = end;
    slider.addEventListener("input", () => this.seek(Number(slider.value)));
    $("play").addEventListener("click", () => this.setPlaying(!this.playing));
    const wanted = this.mission.opening.speed ?? (end - first) / 60;
    this.speeds = [...new Set([1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10000, 20000, 50000,
      ...(this.mission.opening.speed ? [wanted] : [])])].sort((a, b) => a - b);
    for (const speed of this.speeds) $("speed").add(new Option(`× ${speed}`, speed));
    this.setSpeed(this.speeds.reduce(
      (best, one) => Math.abs(Math.log(one / wanted)) < Math.abs(Math.log(best / wanted)) ? one : best));
    $("speed").addEventListener("change", () => this.setSpeed(Number($("speed").value)));
  }

  setSpeed(speed) {
    this.speed = speed;
    $("speed").value = speed;
  }

  buildLegend() {
    const { tracks, scale, profile } = this.mission, legend = $("legend");
    const row = (mark, text) => {
      const line = document.createElement("div");
      line.append(mark, text);
      legend.append(line);
    };
    const swatch = colour => {
      const mark = document.createElement("i");
      mark.style.background = css(colour);
      return mark;
    };
    for (const track of tracks) row(swatch(track.colour), track.name);
    if (profile) {
      const arrow = document.createElement("span");
      arrow.innerHTML = '<svg viewBox="0 0 26 12"><path d="M0 6h16M15 1l11 5-11 5z" stroke="#fff" '
        + 'stroke-width="2" fill="#fff"/></svg>';
      row(arrow, `${profile.name}, up to ${profile.strongest.toFixed(profile.strongest < 0.01 ? 3 : 2)} m/s`);
    }
    const title = document.createElement("div"), bar = document.createElement("div");
    const ends = document.createElement("div");
    title.textContent = scale.label;
    bar.className = "bar";
    bar.style.background = `linear-gradient(90deg, ${scale.colours.map(css).join(",")})`;
    ends.className = "ends";
    for (const end of [scale.low, scale.high]) {
      const text = document.createElement("span");
      text.textContent = scale.high < 10 ? end.toFixed(2) : end.toFixed(0);
      ends.append(text);
    }
    legend.append(title, bar, ends);
  }

  buildCameras() {
    const bar = $("cameras");
    this.cameraButtons = {};
    const button = (text, title, action) => {
      const made = document.createElement("button");
      Object.assign(made, { type: "button", textContent: text, title });
      made.addEventListener("click", action);
      bar.append(made);
      return made;
    };
    if (this.scene instanceof FlatMap) return;
    for (const [k, name] of CAMERAS.entries()) {
      this.cameraButtons[name] = button(name, `${CAMERA_TITLES[name]} (${k + 1})`, () => this.chooseCamera(name));
    }
    button("reset", "the camera as it was (R)", () => this.chooseCamera(this.scene.name));
    bar.append(document.createElement("span"));
    if (this.mission.profile) {
      this.currents = button("currents", "show the current's arrows (C)", () => this.toggleCurrents());
      this.currents.setAttribute("aria-pressed", "true");
    }
    this.markCamera();
  }

  chooseCamera(name) {
    this.scene.show(name);
    this.markCamera();
  }

  markCamera() {
    for (const [name, button] of Object.entries(this.cameraButtons)) {
      button.setAttribute("aria-pressed", String(name === this.scene.name));
    }
    this.touch();
  }

  toggleCurrents() {
    if (!this.currents) return;
    this.scene.withCurrents = !this.scene.withCurrents;
    this.currents.setAttribute("aria-pressed", String(this.scene.withCurrents));
    this.touch();
  }

  buildHelp() {
    const keys = [
      ["Space", "play, pause"], ["← →", "2 % back, forward; with Shift one sample"],
      ["Home End", "first, last moment"], ["[ ]", "slower, faster"],
      ["1 2 3 4", CAMERAS.join(", ")], ["R", "reset the camera"], ["C", "currents"],
      ["drag", "turn; on the map: move"], ["Shift drag", "move; on a touch screen: two fingers"],
      ["wheel", "nearer, farther; on a touch screen: pinch"]];
    const help = $("help"), table = document.createElement("table");
    for (const [key, meaning] of keys) {
      const row = table.insertRow(), name = document.createElement("kbd");
      name.textContent = key;
      row.insertCell().append(name);
      row.insertCell().textContent = meaning;
    }
    help.append(table);
    for (const text of this.mission.notes) {
      const line = document.createElement("p");
      line.textContent = text;
      help.append(line);
    }
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const focused = document.activeElement, { first, last, end, times } = this.recording;
    if (focused instanceof HTMLSelectElement) return;
    const jump = way => {
      if (!event.shiftKey) return this.seek(this.time + way * 0.02 * (end - first));
      const [k, part] = locate(times, this.time);
      const next = way > 0 ? k + (part === 1 ? 2 : 1) : part > 0 ? k : k - 1;
      return this.seek(times[clamp(next, 0, times.length - 1)]);
    };
    const faster = way => this.setSpeed(
      this.speeds[clamp(this.speeds.indexOf(this.speed) + way, 0, this.speeds.length - 1)]);
    const actions = {
      " ": () => this.setPlaying(!this.playing), ArrowLeft: () => jump(-1), ArrowRight: () => jump(1),
      Home: () => this.seek(first), End: () => this.seek(last), "[": () => faster(-1), "]": () => faster(1),
      r: () => this.chooseCamera(this.scene.name), c: () => this.toggleCurrents() };
    CAMERAS.forEach((name, k) => { actions[k + 1] = () => this.chooseCamera(name); });
    const action = actions[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!action || (event.key === " " && focused?.closest("button, summary"))) return;
    event.preventDefault();
    action();
  }
}

const css = colour => `rgb(${colour.map(c => Math.round(255 * c)).join(" ")})`;

// A canvas as many pixels wide as the screen shows; its context counts in CSS pixels.
function fitCanvas(canvas) {
  const ratio = Math.min(devicePixelRatio || 1, 2), { clientWidth: wide, clientHeight: high } = canvas;
  if (canvas.width !== Math.round(wide * ratio) || canvas.height !== Math.round(high * ratio)) {
    canvas.width = Math.max(1, Math.round(wide * ratio));
    canvas.height = Math.max(1, Math.round(high * ratio));
  }
  return { wide, high, ratio };
}

// Depth against time, with the moment that is shown; a press goes there.
class Strip {
  constructor(canvas, page) {
    this.canvas = canvas;
    this.page = page;
    const seek = event => {
      if (event.type === "pointermove" && !event.buttons) return;
      const frame = canvas.getBoundingClientRect(), { first, last } = page.recording;
      page.seek(first + (event.clientX - frame.left) / frame.width * (last - first));
    };
    canvas.addEventListener("pointerdown", event => { canvas.setPointerCapture(event.pointerId); seek(event); });
    canvas.addEventListener("pointermove", seek);
  }

  draw() {
    const { canvas, page } = this, { wide, high, ratio } = fitCanvas(canvas);
    const { recording } = page, { first, end, times, channels } = recording;
    const style = getComputedStyle(document.documentElement), ink = name => style.getPropertyValue(name);
    const context = canvas.getContext("2d"), top = 4, bottom = high - 4;
    let deepest = this.page.mission.live ? this.page.mission.live.depth : 1;
    for (const d of channels.depth) if (d > deepest) deepest = d;
    const x = t => (t - first) / (end - first) * wide;
    const y = d => top + Math.max(d, 0) / deepest * (bottom - top);
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, wide, high);
    context.strokeStyle = ink("--line");
    context.lineWidth = 1;
    context.beginPath();
    context.moveTo(0, top);
    context.lineTo(wide, top);
    context.stroke();
    if (channels.bottom) {
      context.beginPath();
      context.moveTo(0, high);
      const step = Math.max(1, Math.floor(times.length / wide));
      for (let i = 0; i < times.length; i += step) context.lineTo(x(times[i]), Math.min(y(channels.bottom[i]), high));
      context.lineTo(wide, high);
      context.fillStyle = "#8f8266";
      context.fill();
    }
    // Shallowest and deepest of each pixel: no turn of a dive is left out.
    context.strokeStyle = ink("--dim");
    context.lineWidth = 1.3;
    context.lineJoin = "round";
    context.beginPath();
    for (let k = 0; k < times.length;) {
      const column = Math.floor(x(times[k]));
      let low = k, deep = k, next = k;
      for (; next < times.length && Math.floor(x(times[next])) === column; next++) {
        if (channels.depth[next] < channels.depth[low]) low = next;
        if (channels.depth[next] > channels.depth[deep]) deep = next;
      }
      for (const i of [...new Set([k, low, deep, next - 1])].sort((a, b) => a - b)) {
        context.lineTo(x(times[i]), y(channels.depth[i]));
      }
      k = next;
    }
    context.stroke();
    const depth = between(channels.depth, locate(times, page.time));
    context.fillStyle = ink("--ink");
    context.fillRect(x(page.time) - 0.5, 0, 1, high);
    context.beginPath();
    context.arc(x(page.time), y(depth), 5, 0, 7);
    context.fillStyle = ink("--accent");
    context.fill();
    context.strokeStyle = ink("--ink");
    context.lineWidth = 1.5;
    context.stroke();
    context.fillStyle = ink("--dim");
    context.font = "11px system-ui, sans-serif";
    context.textAlign = "left";
    context.strokeStyle = ink("--panel");
    context.lineWidth = 4;
    context.strokeText(`${deepest.toFixed(0)} m`, 2, high - 3);
    context.fillText(`${deepest.toFixed(0)} m`, 2, high - 3);
  }
}

// Without WebGL2: the tracks from above in two dimensions.
class FlatMap {
  constructor(canvas, page) {
    this.canvas = canvas;
    this.page = page;
    this.name = "map";
  }

  show() {}

  extend() {}

  draw(state) {
    const { canvas, page } = this, { wide, high, ratio } = fitCanvas(canvas);
    const { north, east } = page.recording.channels, context = canvas.getContext("2d");
    const others = page.mission.tracks.map(track => ({
      colour: css(track.colour), north: unpack(track.north), east: unpack(track.east) }));
    const all = [{ north, east, colour: css(page.mission.scale.colours.at(-8)) }, ...others];
    const range = name => all.reduce(([low, high], one) => one[name].reduce(
      ([a, b], v) => [Math.min(a, v), Math.max(b, v)], [low, high]), [Infinity, -Infinity]);
    const [south, farNorth] = range("north"), [west, farEast] = range("east");
    const scale = 0.72 * Math.min(wide / Math.max(farEast - west, 1), high / Math.max(farNorth - south, 1));
    const at = (n, e) => [
      wide / 2 + (e - (west + farEast) / 2) * scale, high / 2 - (n - (south + farNorth) / 2) * scale];
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.fillStyle = "#0c2748";
    context.fillRect(0, 0, wide, high);
    context.lineWidth = 2.5;
    for (const one of all) {
      context.strokeStyle = one.colour;
      context.beginPath();
      const step = Math.max(1, Math.floor(one.north.length / 8000));
      for (let i = 0; i < one.north.length; i += step) context.lineTo(...at(one.north[i], one.east[i]));
      context.stroke();
    }
    const [x, y] = at(state.north, state.east), heading = state.heading * RADIANS;
    context.save();
    context.translate(x, y);
    context.rotate(heading);
    context.fillStyle = "#fff";
    context.beginPath();
    for (const [px, py] of [[0, -11], [6, 8], [0, 4], [-6, 8]]) context.lineTo(px, py);
    context.fill();
    context.restore();
    drawScaleBar(context, scale, wide, high);
    drawCompass(context, 40, compassTop(), -Math.PI / 2);
  }
}

function niceStep(rough) {
  const power = 10 ** Math.floor(Math.log10(rough));
  return [1, 2, 5, 10].map(m => m * power).reduce(
    (best, one) => Math.abs(Math.log(one / rough)) < Math.abs(Math.log(best / rough)) ? one : best);
}

const metres = value => value >= 2000 ? `${+(value / 1000).toPrecision(4)} km` : `${+value.toPrecision(4)} m`;

function drawScaleBar(context, pixelsPerMetre, wide, high) {
  const long = niceStep(110 / pixelsPerMetre), px = long * pixelsPerMetre;
  const x = wide - 24 - px, y = high - $("cameras").offsetHeight - 26;
  context.fillStyle = context.strokeStyle = "#fff";
  context.lineWidth = 2;
  context.beginPath();
  for (const [a, b] of [[x, y - 5], [x, y], [x + px, y], [x + px, y - 5]]) context.lineTo(a, b);
  context.stroke();
  text(context, metres(long), x + px / 2, y - 9, "center");
}

// Under the title, however many lines it has.
const compassTop = () => document.querySelector("header").offsetHeight + 46;

// A needle towards north; `angle` is its direction in the picture.
function drawCompass(context, x, y, angle) {
  context.save();
  context.translate(x, y);
  context.strokeStyle = "#cfe4f0";
  context.lineWidth = 1.2;
  context.beginPath();
  context.arc(0, 0, 19, 0, 7);
  context.stroke();
  context.save();
  context.rotate(angle);
  for (const [way, colour] of [[1, "#ff6b4a"], [-1, "#ffffff"]]) {
    context.fillStyle = colour;
    context.beginPath();
    for (const [px, py] of [[15 * way, 0], [0, 5], [0, -5]]) context.lineTo(px, py);
    context.fill();
  }
  context.restore();
  text(context, "N", 28 * Math.cos(angle), 28 * Math.sin(angle) + 4, "center", "bold 13px");
  context.restore();
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
