"use strict";
// Share: a link to the moment that is shown, and the view as a picture.

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
  const canvas = Object.assign(document.createElement("canvas"), { width, height });
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
function paintLegend(context, { scale, tracks, profile }, right, top) {
  const rows = tracks.map(({ name, colour }) => [css(colour), name]);
  if (scale.gaps) rows.push(["#999", "colour not known"]);
  const lines = [...rows.map(row => row[1]), scale.label, ...(profile ? [`→ ${currentName(profile)}`] : [])];
  const long = Math.max(180, ...lines.map(words => context.measureText(words).width + 34)), x = right - long;
  let y = top;
  context.fillStyle = "#06101c99";
  context.fillRect(x - 10, y - 6, long + 20, 19 * lines.length + 42);
  for (const [colour, name] of rows) {
    context.fillStyle = colour;
    context.fillRect(x, y + 6, 26, 4);
    text(context, name, x + 34, y + 12);
    y += 19;
  }
  if (profile) {
    text(context, lines.at(-1), x, y + 12);
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
