"use strict";
// Water: the block of sea that holds the track, with its levels of depth, and the sea floor.

class Water {
  constructor(renderer, { block, palette, floor }) {
    Object.assign(this, { renderer, block, palette });
    this.centre = this.toWorld((block.low[0] + block.high[0]) / 2, (block.low[1] + block.high[1]) / 2, 0);
    this.sides = [[block.low[0], block.low[1]], [block.high[0], block.low[1]],
      [block.high[0], block.high[1]], [block.low[0], block.high[1]]];
    this.corners = [0, block.high[2]].flatMap(z => this.sides.map(([x, y]) => this.toWorld(x, y, z)));
    this.buildWalls();
    this.buildSheets();
    this.buildLevels();
    this.ground = floor ? this.buildGround(unpack(floor.depths), floor.count) : null;
  }

  // Block axes (x along the track, y to its right, z down) to the world, unstretched.
  toWorld(x, y, z) {
    const c = Math.cos(this.block.azimuth), s = Math.sin(this.block.azimuth);
    return [c * x - s * y, -(s * x + c * y), -z];
  }

  local(x, y, z) { return Vector.sub(this.toWorld(x, y, z), this.centre); }

  buildWalls() {
    const deep = this.block.high[2], colours = this.palette.water;
    this.walls = this.sides.map(([x, y], k) => {
      const [u, v] = this.sides[(k + 1) % 4], shape = new Shape();
      for (let i = 0; i + 1 < colours.length; i++) {
        const [[s, ...top], [t, ...under]] = [colours[i], colours[i + 1]];
        const [a, b] = [s * deep, t * deep];
        shape.quad(this.local(x, y, a), this.local(u, v, a), this.local(u, v, b), this.local(x, y, b),
          [[...top, 1], [...top, 1], [...under, 1], [...under, 1]]);
      }
      const middle = this.toWorld((x + u) / 2, (y + v) / 2, 0);
      return { mesh: shape.upload(this.renderer), middle, outward: Vector.sub(middle, this.centre) };
    });
  }

  // The bottom of the block, the map's ground, and the surface over the block and over open water.
  buildSheets() {
    const { low, high } = this.block, colours = this.palette.water;
    const sheet = (corners, colour) => {
      const shape = new Shape();
      shape.quad(...corners, colour);
      return shape.upload(this.renderer);
    };
    const square = (half, z) => [[-half, -half, z], [half, -half, z], [half, half, z], [-half, half, z]];
    const [light, dark] = [2, 3].map(k => colours.at(k).slice(1));
    this.bottom = sheet(this.sides.map(([x, y]) => this.local(x, y, high[2])), [...colours.at(-1).slice(1), 1]);
    this.chart = sheet(square(40 * Math.max(high[0] - low[0], high[1] - low[1]), -high[2]),
      [...light.map((c, k) => 0.4 * c + 0.6 * dark[k]), 1]);
    this.lid = sheet(this.sides.map(([x, y]) => this.local(x, y, 0)), [0.75, 0.93, 1, 0.2]);
    this.openLid = sheet(square(400, 0), [0.6, 0.85, 0.95, 0.35]);
  }

  // Rims of the surface, and lines round the block at round depths.
  buildLevels() {
    const deep = this.block.high[2], step = niceStep(deep / 4);
    const line = (corners, d) => this.renderer.path({
      north: corners.map(c => c[0]), west: corners.map(c => c[1]), depth: corners.map(() => d) });
    this.edges = line([0, 1, 2, 3, 0].map(k => this.corners[k]), 0);
    this.levels = [];
    for (let d = step; d < 0.97 * deep; d += step) this.levels.push(d);
    this.levelPaths = this.walls.map((_, k) => this.levels.map(
      d => line([this.corners[k], this.corners[(k + 1) % 4]], d)));
  }

  // The sea floor as the top of a block of ground; depths (n, n) over the block, north first.
  buildGround(depths, n) {
    const { low, high } = this.block, { sand } = this.palette, shape = new Shape();
    const at = (i, j) => this.local(low[0] + (high[0] - low[0]) * i / (n - 1),
      high[1] - (high[1] - low[1]) * j / (n - 1), Math.min(depths[i * n + j], high[2]));
    let [least, most] = [Infinity, -Infinity];
    for (const d of depths) { least = Math.min(least, d); most = Math.max(most, d); }
    const tint = d => {                                // lighter where it is shallower
      const share = 1.12 - 0.34 * (Math.min(d, high[2]) - least) / Math.max(most - least, 1);
      return [...sand.map(c => Math.min(1, c * share)), 1];
    };
    for (let i = 0; i + 1 < n; i++) {
      for (let j = 0; j + 1 < n; j++) {
        const [a, b, c, d] = [[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]];
        shape.quad(at(...a), at(...b), at(...c), at(...d), [a, b, c, d].map(([p, q]) => tint(depths[p * n + q])));
      }
    }
    const dark = [...sand.map(c => 0.55 * c), 1], down = p => [p[0], p[1], -high[2]];
    const rims = [k => [0, k], k => [n - 1, k], k => [k, 0], k => [k, n - 1]];
    for (const rim of rims) {
      for (let k = 0; k + 1 < n; k++) {
        const [p, q] = [at(...rim(k)), at(...rim(k + 1))];
        shape.quad(p, q, down(q), down(p), dark);
      }
    }
    return shape.upload(this.renderer);
  }

  // The block, or the map's ground, as far as it does not hide the track; `px` is a line's width.
  drawBehind(name, eye, stretch, px) {
    const { renderer } = this, block = { place: this.centre, stretched: true, flat: 1 };
    if (name !== "map") {
      this.walls.forEach(({ mesh, middle, outward }, k) => {
        if (Vector.dot(Vector.sub(eye, middle), outward) > 0) return;
        renderer.drawMesh(mesh, block);
        for (const path of this.levelPaths[k]) {
          renderer.drawPath(path, { wide: 1.8 * px, colour: [0.5, 0.72, 0.86] });
        }
      });
    }
    if (eye[2] > -this.block.high[2] * stretch) {
      renderer.drawMesh(name === "map" ? this.chart : this.bottom, block);
    }
    if (this.ground) renderer.drawMesh(this.ground, { ...block, flat: 0.15 });
    if (name !== "map") renderer.drawPath(this.edges, { wide: 2 * px, colour: [0.92, 0.98, 1] });
  }

  drawOpenGround() {
    if (this.ground) this.renderer.drawMesh(this.ground, { place: this.centre, stretched: true });
  }

  // The surface, last of all, since one looks through it.
  drawSurface(name, here) {
    const look = { blend: true, flat: 1 };
    if (name === "chase") this.renderer.drawMesh(this.openLid, { ...look, place: [here[0], here[1], 0] });
    else if (name !== "map") {
      this.renderer.drawMesh(this.lid, { ...look, place: this.centre, stretched: true });
    }
  }
}
