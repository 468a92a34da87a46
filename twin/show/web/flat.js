"use strict";
// Flat: without WebGL2, the tracks from above in two dimensions.

class FlatMap {
  constructor(canvas, page) {
    this.canvas = canvas;
    this.page = page;
    this.name = "map";
    this.others = page.mission.tracks.map(track => ({
      colour: css(track.colour), north: unpack(track.north), east: unpack(track.east) }));
  }

  show() {}

  extend() {}

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
