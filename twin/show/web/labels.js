"use strict";
// Labels: words over the picture of a scene. Depths, distances, scale, north, and what is not at
// true scale.

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
