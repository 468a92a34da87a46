"use strict";
// Controls: readouts, time line, legend, camera buttons and help, as the page is built.

const $ = name => document.getElementById(name);

function made(tag, properties = {}, ...inside) {
  const one = Object.assign(document.createElement(tag), properties);
  one.append(...inside);
  return one;
}

// The elements that show the values, by name.
function buildReadouts(items) {
  const values = {};
  const names = [["time", "hours, minutes and seconds since the mission's start"], ...items];
  for (const [name, meaning] of names) {
    const value = values[name] = made("dd");
    value.dataset.name = name;
    const wide = { current: "wide", "date, UTC": "wide", position: "widest" }[name] ?? "";
    $("readouts").append(made("div", { title: meaning, className: wide }, made("dt", { textContent: name }), value));
  }
  return values;
}

// Slider, buttons and speeds; returns the speeds, slowest first.
function buildTransport(page) {
  const { first, end } = page.recording, slider = $("slider");
  slider.min = first;
  slider.max = end;
  slider.addEventListener("input", () => page.seek(Number(slider.value)));
  const does = {
    play: () => page.setPlaying(!page.playing), before: () => page.surface(-1), next: () => page.surface(1) };
  for (const [name, action] of Object.entries(does)) $(name).addEventListener("click", action);
  const wanted = page.mission.opening.speed ?? (end - first) / 60;
  const speeds = [...new Set([1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10000, 20000, 50000,
    ...(page.mission.opening.speed ? [wanted] : [])])].sort((a, b) => a - b);
  for (const speed of speeds) $("speed").add(new Option(`× ${speed}`, speed));
  page.setSpeed(speeds.reduce(
    (best, one) => Math.abs(Math.log(one / wanted)) < Math.abs(Math.log(best / wanted)) ? one : best));
  $("speed").addEventListener("change", () => page.setSpeed(Number($("speed").value)));
  return speeds;
}

function buildLegend({ tracks, scale, profile }) {
  const legend = $("legend"), row = (mark, words) => legend.append(made("div", {}, mark, words));
  const swatch = background => {
    const mark = made("i");
    mark.style.background = background;
    return mark;
  };
  for (const track of tracks) row(swatch(css(track.colour)), track.name);
  if (profile) {
    const arrow = made("span", { innerHTML: '<svg viewBox="0 0 26 12"><path d="M0 6h16M15 1l11 5-11 5z" '
      + 'stroke="#fff" stroke-width="2" fill="#fff"/></svg>' });
    row(arrow, currentName(profile));
  }
  if (scale.gaps) row(swatch("#999"), "colour not known");
  const bar = made("div", { className: "bar" });
  bar.style.background = `linear-gradient(90deg, ${scale.colours.map(css).join(",")})`;
  legend.append(made("div", { textContent: scale.label }), bar,
    made("div", { className: "ends" }, ...scale.ends.map(end => made("span", { textContent: end }))));
}

// Buttons by camera, and those that are on or off by what they switch.
function buildCameras(page) {
  const bar = $("cameras"), cameras = {}, switches = {};
  const button = (words, title, action) => {
    const one = made("button", { type: "button", textContent: words, title });
    one.addEventListener("click", action);
    bar.append(one);
    return one;
  };
  if (page.scene instanceof Scene) {
    for (const [k, name] of CAMERAS.entries()) {
      cameras[name] = button(name, `${CAMERA_TITLES[name]} (${k + 1})`, () => page.chooseCamera(name));
    }
    switches.follow = button("follow", "keep the vehicle in the middle (F)", () => page.toggleFollowing());
    button("reset", "the camera as it was (R)", () => page.chooseCamera(page.scene.name));
    bar.append(made("span"));
    if (page.mission.profile) {
      switches.currents = button("currents", "show the current's arrows (C)", () => page.toggleCurrents());
    }
  }
  button("link", "copy a link to this moment (L)", () => copyLink(page));
  button("picture", "save the view as a picture (S)", () => savePicture(page));
  return { cameras, switches };
}

function buildHelp(notes) {
  const keys = [
    ["Space", "play, pause"], ["N P", "next, previous surfacing"],
    ["← →", "2 % back, forward; with Shift one sample"], ["Home End", "first, last moment"],
    ["[ ]", "slower, faster"], ["1 2 3 4", CAMERAS.join(", ")], ["F", "follow the vehicle"],
    ["R", "reset the camera"], ["C", "currents"], ["L", "copy a link to this moment"],
    ["S", "save the view as a picture (PNG)"], ["?", "this help; Escape closes it"],
    ["drag", "turn; on the map: move"], ["Shift drag", "move; on a touch screen: two fingers"],
    ["wheel", "nearer, farther; on a touch screen: pinch"],
    ["on the curve", "press: go there; wheel or pinch: a part of the mission; double click: all of it"]];
  const table = made("table");
  for (const [key, meaning] of keys) {
    const row = table.insertRow();
    row.insertCell().append(made("kbd", { textContent: key }));
    row.insertCell().textContent = meaning;
  }
  $("help").append(table, ...notes.map(words => made("p", { textContent: words })));
}

// What a pressed key does to the page.
function keyActions(page, event) {
  const { first, last, end, times } = page.recording;
  const jump = way => {
    if (!event.shiftKey) return page.seek(page.time + way * 0.02 * (end - first));
    const [k, part] = locate(times, page.time);
    const next = way > 0 ? k + (part === 1 ? 2 : 1) : part > 0 ? k : k - 1;
    return page.seek(times[clamp(next, 0, times.length - 1)]);
  };
  const faster = way => page.setSpeed(
    page.speeds[clamp(page.speeds.indexOf(page.speed) + way, 0, page.speeds.length - 1)]);
  const actions = {
    " ": () => page.setPlaying(!page.playing), ArrowLeft: () => jump(-1), ArrowRight: () => jump(1),
    Home: () => page.seek(first), End: () => page.seek(last), "[": () => faster(-1), "]": () => faster(1),
    n: () => page.surface(1), p: () => page.surface(-1), f: () => page.toggleFollowing(),
    r: () => page.chooseCamera(page.scene.name), c: () => page.toggleCurrents(),
    l: () => copyLink(page), s: () => savePicture(page), "?": () => page.toggleHelp(),
    Escape: () => page.toggleHelp(false) };
  CAMERAS.forEach((name, k) => { actions[k + 1] = () => page.chooseCamera(name); });
  return actions;
}
