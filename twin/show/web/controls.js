"use strict";
// Controls: readouts, time line, legend, buttons, keys and help as the page is built; a link to the
// moment that is shown, and the view as a picture.

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
  page.setSpeed(nearest(speeds, wanted));
  $("speed").addEventListener("change", () => page.setSpeed(Number($("speed").value)));
  return speeds;
}

// The lines of the legend above the colour scale: a colour, or none for the current's arrow, and words.
function legendLines({ tracks, scale, profile }) {
  const lines = tracks.map(({ name, colour }) => [css(colour), name]);
  if (profile) lines.push([null, currentName(profile)]);
  if (scale.gaps) lines.push(["#999", "colour not known"]);
  return lines;
}

function buildLegend(mission) {
  const { scale } = mission, legend = $("legend");
  const arrow = '<svg viewBox="0 0 26 12"><path d="M0 6h16M15 1l11 5-11 5z" stroke="#fff" stroke-width="2" fill="#fff"/></svg>';
  for (const [colour, words] of legendLines(mission)) {
    const mark = colour ? made("i") : made("span", { innerHTML: arrow });
    if (colour) mark.style.background = colour;
    legend.append(made("div", {}, mark, words));
  }
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

// Keys and hands: how help names them, their meaning, and the actions of keys.
function keysOf(page) {
  const { recording } = page;
  const jump = (way, { shiftKey }) => {
    const { first, end, times } = recording;
    if (!shiftKey) return page.seek(page.time + way * 0.02 * (end - first));
    const [k, part] = locate(times, page.time);
    const next = way > 0 ? k + (part === 1 ? 2 : 1) : part > 0 ? k : k - 1;
    return page.seek(times[clamp(next, 0, times.length - 1)]);
  };
  const faster = way => page.setSpeed(
    page.speeds[clamp(page.speeds.indexOf(page.speed) + way, 0, page.speeds.length - 1)]);
  const cameras = Object.fromEntries(CAMERAS.map((name, k) => [k + 1, () => page.chooseCamera(name)]));
  return [
    ["Space", "play, pause", { " ": () => page.setPlaying(!page.playing) }],
    ["N P", "next, previous surfacing", { n: () => page.surface(1), p: () => page.surface(-1) }],
    ["← →", "2 % back, forward; with Shift one sample",
      { ArrowLeft: event => jump(-1, event), ArrowRight: event => jump(1, event) }],
    ["Home End", "first, last moment",
      { Home: () => page.seek(recording.first), End: () => page.seek(recording.last) }],
    ["[ ]", "slower, faster", { "[": () => faster(-1), "]": () => faster(1) }],
    ["1 2 3 4", CAMERAS.join(", "), cameras],
    ["F", "follow the vehicle", { f: () => page.toggleFollowing() }],
    ["R", "reset the camera", { r: () => page.chooseCamera(page.scene.name) }],
    ["C", "currents", { c: () => page.toggleCurrents() }],
    ["L", "copy a link to this moment", { l: () => copyLink(page) }],
    ["S", "save the view as a picture (PNG)", { s: () => savePicture(page) }],
    ["?", "this help; Escape closes it", { "?": () => page.toggleHelp(), Escape: () => page.toggleHelp(false) }],
    ["drag", "turn; on the map: move"], ["Shift drag", "move; on a touch screen: two fingers"],
    ["wheel", "nearer, farther; on a touch screen: pinch"],
    ["on the curve", "press: go there; wheel or pinch: a part of the mission; double click: all of it"]];
}

function buildHelp(keys, notes) {
  const table = made("table");
  for (const [key, meaning] of keys) {
    const row = table.insertRow();
    row.insertCell().append(made("kbd", { textContent: key }));
    row.insertCell().textContent = meaning;
  }
  $("help").append(table, ...notes.map(words => made("p", { textContent: words })));
}

// The page's address with its moment and camera.
function linkTo(page) {
  const time = +page.time.toFixed(3);
  return `${location.href.split("#")[0]}#t=${time}&camera=${page.scene.name}`;
}

async function copyLink(page) {
  const link = linkTo(page);
  history.replaceState(null, "", link);
  try {
    await navigator.clipboard.writeText(link);
    page.tell("link to this moment copied");
  } catch {                                            // without https, or not allowed
    page.tell("the address bar has the link to this moment");
  }
}

// The view with title, legend, moment and depth, as a canvas.
function paintView(page) {
  const { scene, mission } = page;
  scene.draw(page.recording.at(page.time), 0, true);   // a picture is gone once it was shown
  const pictures = [scene.canvas, $("marks")], { width, height } = $("marks");
  const canvas = made("canvas", { width, height });
  const context = canvas.getContext("2d"), ratio = width / $("marks").clientWidth;
  for (const one of new Set(pictures)) context.drawImage(one, 0, 0, width, height);
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  text(context, mission.title, 16, 28, "left", "bold 17px");
  text(context, $("facts").textContent, 16, 48);
  const when = mission.unix === null ? clock(page.time) : `${moment(mission.unix + page.time)} UTC`;
  const depth = page.recording.at(page.time).depth;
  text(context, `${when} · ${plain(depth, 1)} m deep`, 16, height / ratio - 16, "left", "bold 14px");
  paintLegend(context, mission, width / ratio - 16, 16);
  return canvas;
}

// The legend, as far left of `right` as its longest line needs.
function paintLegend(context, mission, right, top) {
  const { scale } = mission, rows = legendLines(mission).map(
    ([colour, words]) => [colour, colour ? words : `→ ${words}`]);
  const long = Math.max(180, ...[...rows.map(row => row[1]), scale.label].map(
    words => context.measureText(words).width + 34)), x = right - long;
  let y = top;
  context.fillStyle = "#06101c99";
  context.fillRect(x - 10, y - 6, long + 20, 19 * rows.length + 61);
  for (const [colour, words] of rows) {
    if (colour) {
      context.fillStyle = colour;
      context.fillRect(x, y + 6, 26, 4);
    }
    text(context, words, colour ? x + 34 : x, y + 12);
    y += 19;
  }
  text(context, scale.label, x, y + 12);
  const shade = context.createLinearGradient(x, 0, right, 0);
  scale.colours.forEach((colour, k) => shade.addColorStop(k / (scale.colours.length - 1), css(colour)));
  context.fillStyle = shade;
  context.fillRect(x, y + 19, long, 11);
  text(context, scale.ends[0], x, y + 45);
  text(context, scale.ends[1], right, y + 45, "right");
}

const currentName = ({ name, strongest }) =>
  `${name}, up to ${strongest.toFixed(strongest < 0.01 ? 3 : 2)} m/s`;

async function savePicture(page) {
  const picture = await new Promise(done => paintView(page).toBlob(done, "image/png"));
  const link = document.createElement("a"), title = page.mission.title.replace(/[^\w.-]+/g, "_");
  link.href = URL.createObjectURL(picture);
  link.download = `${title}_${Math.round(page.time)}s.png`;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  page.tell(`${link.download} saved`);
}
