"use strict";
// Bodies: the block of sea with its levels and floor, the vehicle with its moving parts, and the
// arrows of the current.

class Water {
  constructor(renderer, { block, palette, floor }) {
    Object.assign(this, { renderer, block, palette });
    this.centre = this.toWorld((block.low[0] + block.high[0]) / 2, (block.low[1] + block.high[1]) / 2, 0);
    this.sides = [[block.low[0], block.low[1]], [block.high[0], block.low[1]],
      [block.high[0], block.high[1]], [block.low[0], block.high[1]]];
    this.corners = [0, block.high[2]].flatMap(z => this.sides.map(([x, y]) => this.toWorld(x, y, z)));
    this.buildWalls();
    this.buildSheets();
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
    const sheet = (corners, colour) => new Shape().quad(...corners, colour).upload(this.renderer);
    const square = (half, z) => [[-half, -half, z], [half, -half, z], [half, half, z], [-half, half, z]];
    const [light, dark] = [2, 3].map(k => colours.at(k).slice(1));
    this.bottom = sheet(this.sides.map(([x, y]) => this.local(x, y, high[2])), [...colours.at(-1).slice(1), 1]);
    this.chart = sheet(square(40 * Math.max(high[0] - low[0], high[1] - low[1]), -high[2]),
      [...light.map((c, k) => 0.4 * c + 0.6 * dark[k]), 1]);
    this.lid = sheet(this.sides.map(([x, y]) => this.local(x, y, 0)), [0.75, 0.93, 1, 0.2]);
    this.openLid = sheet(square(400, 0), [0.6, 0.85, 0.95, 0.35]);
    // Rims of the surface, and lines round the block at round depths.
    const deep = high[2], step = niceStep(deep / 4);
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

class VehicleBodies {
  constructor(renderer, bodies) {
    this.renderer = renderer;
    this.bodies = bodies.map(body => {
      const [places, normals, tint] = [body.corners, body.normals, body.tint].map(unpack);
      const solid = new Shape(), glass = new Shape();
      tint.forEach((k, i) => {
        const colour = body.tints[k], part = colour[3] < 1 ? glass : solid;
        part.places.push(...places.subarray(9 * i, 9 * i + 9));
        part.normals.push(...normals.subarray(9 * i, 9 * i + 9));
        part.colours.push(...colour, ...colour, ...colour);
      });
      return { ...body, solid: solid.upload(renderer), glass: glass.upload(renderer) };
    });
  }

  // Where each body is from the hull's middle, and how it is turned, at true size.
  poses(state) {
    const poses = [];
    this.bodies.forEach((body, k) => {
      let place = [0, 0, 0], turn = state.turn;
      if (k > 0) {
        const carrier = poses[body.parent];
        place = Vector.add(carrier.place, Turn.apply(carrier.turn, body.position));
        turn = Turn.times(carrier.turn, body.quaternion);
      }
      for (const { part, kind, axis, anchor } of body.moves) {
        const by = state.angles[part] || 0;
        if (kind === "slide") place = Vector.add(place, Turn.apply(turn, Vector.scale(axis, by)));
        else {
          const fixed = Vector.add(place, Turn.apply(turn, anchor));
          turn = Turn.times(turn, Turn.about(axis, by));
          place = Vector.sub(fixed, Turn.apply(turn, anchor));
        }
      }
      poses.push({ place, turn });
    });
    return poses;
  }

  // At a place, `size` times as large as it is; glass after what is seen through it.
  draw(state, here, size) {
    const poses = this.poses(state);
    for (const blend of [false, true]) {
      this.bodies.forEach((body, k) => {
        const mesh = blend ? body.glass : body.solid, { place, turn } = poses[k];
        if (mesh && !(body.until !== null && state.time >= body.until)) {
          this.renderer.drawMesh(mesh, { place: Vector.add(here, Vector.scale(place, size)), turn, size,
            shine: 0.35, blend, murk: 0.25 });
        }
      });
    }
  }
}

// Arrows of the current: at round depths on a mast where the track leaves most room, along the
// track where only its mean over a dive is known, and at the levels beside the vehicle.
class CurrentArrows {
  constructor(renderer, { profile, palette, block: { low, high } }) {
    Object.assign(this, { renderer, profile, ladder: [] });
    this.mesh = Shape.arrow([...palette.current, 1]).upload(renderer);
    this.perSpeed = ARROW_SHARE * Math.max(high[0] - low[0], high[1] - low[1]) / profile.strongest;
    this.foot = [profile.foot[0], -profile.foot[1]];
    this.mastPath = renderer.path({ north: [this.foot[0], this.foot[0]],
      west: [this.foot[1], this.foot[1]], depth: [0, high[2]] });
  }

  // Places and currents at 16 equal distances along the track; again when a live mission has gone on.
  arrange({ north, east, depth, current_north: cn, current_east: ce }) {
    const lengths = new Float64Array(north.length);
    this.along = [];
    for (let i = 1; i < north.length; i++) {
      lengths[i] = lengths[i - 1] + Math.hypot(north[i] - north[i - 1], east[i] - east[i - 1]);
    }
    for (let k = 0.5; cn && k < 16; k++) {
      const where = locate(lengths, k / 16 * lengths.at(-1));
      const [n, e, d, u, v] = [north, east, depth, cn, ce].map(values => between(values, where));
      if (Number.isFinite(u + v)) this.along.push({ place: [n, -e, -d], current: [u, v] });
    }
  }

  // North and east [m/s] of the mean profile.
  at(depth) {
    const { depth: depths, north, east } = this.profile;
    if (depths.length < 2) return [north[0], east[0]];
    const where = locate(depths, clamp(depth, depths[0], depths.at(-1)));
    return [between(north, where), between(east, where)];
  }

  drawArrow(place, [north, east], perSpeed, least) {
    const speed = Math.hypot(north, east), long = speed * perSpeed;
    if (long < least) return;
    this.renderer.drawMesh(this.mesh, {
      place, turn: Turn.about([0, 0, 1], Math.atan2(-east, north)), size: long, murk: 0.3 });
  }

  drawBlock(name, stretch, metresPerPixel, px) {
    const least = 6 * metresPerPixel, { mast } = this.profile;
    this.ladder = [];
    if (mast.length && name !== "map") {
      this.renderer.drawPath(this.mastPath, { wide: px, colour: [0.85, 0.92, 0.96] });
      for (const d of mast) {
        this.drawArrow([this.foot[0], this.foot[1], -d * stretch], this.at(d), this.perSpeed, least);
      }
    } else {
      for (const { place, current } of this.along) {
        this.drawArrow([place[0], place[1], place[2] * stretch], current, 0.7 * this.perSpeed, least);
      }
    }
  }

  // Beside the vehicle, with the depths that they are labelled with in `ladder`.
  drawLadder(state, aspect) {
    const { profile } = this, heading = state.heading * RADIANS;
    const c = Math.cos(heading), s = Math.sin(heading), [ahead, aside] = [0.2, -3 * Math.min(1, aspect)];
    const x = state.north + ahead * c - aside * s, y = -state.east - (ahead * s + aside * c);
    const levels = profile.averaged ? [state.depth] : [];
    for (let d = Math.ceil(state.depth - 2.6); !profile.averaged && d <= state.depth + 2.6; d++) levels.push(d);
    this.ladder = [];
    for (const d of levels) {
      if (d < 0) continue;
      const flow = profile.averaged ? [state.current_north, state.current_east] : this.at(d);
      if (!Number.isFinite(flow[0])) continue;
      const place = [x, y, -d];
      this.ladder.push([d, place]);
      this.drawArrow(place, flow, LONGEST_LADDER / profile.strongest, 0.02);
    }
  }
}
