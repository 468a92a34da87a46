"use strict";
// Scene: the water, the floor, tracks, currents and the vehicle of one mission, and its cameras.

const CAMERAS = ["orbit", "side", "map", "chase"];
const CAMERA_TITLES = {
  orbit: "the whole track from one side and above", side: "across the track",
  map: "from above, north up", chase: "behind the vehicle, at true scale" };
const NARROW = 14 * RADIANS, WIDE = 24 * RADIANS;      // half of the vertical field of view
const CHASE = { bearing: 142 * RADIANS, elevation: 16 * RADIANS, lengths: 2.06, lag: 1.2 };
const ARROW_SHARE = 0.13, LONGEST_LADDER = 1.0;        // of the block's length; metres
const TAIL = 0.47;                                     // of the hull's length, behind its middle
const VEHICLE_SHARE = 0.085, LEAST_PIXELS = 84;        // of the picture's width

class Scene {
  constructor(canvas, marks, page) {
    Object.assign(this, { canvas, marks, page, name: "orbit", withCurrents: true });
    const { mission } = page;
    this.mission = mission;
    this.renderer = new Renderer(canvas, mission.palette);
    this.renderer.setScale(mission.scale.colours);
    this.camera = new Camera();
    this.block = mission.block;
    this.centre = this.toWorld((this.block.low[0] + this.block.high[0]) / 2,
      (this.block.low[1] + this.block.high[1]) / 2, 0);
    this.extend();
    this.others = mission.tracks.map(track => {
      const [times, n, e, d] = ["time", "north", "east", "depth"].map(name => unpack(track[name]));
      return { times, colour: track.colour,
        path: this.renderer.path({ north: n, west: e.map(x => -x), depth: d }) };
    });
    this.buildWater();
    this.buildVehicle();
    this.arrow = Shape.arrow([...mission.palette.current, 1]).upload(this.renderer);
    this.listen();
  }

  // The track as far as it is known; again when a live mission has gone on.
  extend() {
    const { north, east, depth, colour, gap, bottom } = this.page.recording.channels;
    const deep = this.block.high[2];
    if (this.track) this.renderer.forget(this.track);
    this.track = this.renderer.path({
      north, west: east.map(e => -e), depth, gap, colour: colour.map(c => c / this.mission.scale.steps),
      floor: bottom ? bottom.map(b => Math.min(b, deep)) : depth.map(() => deep) });
    if (this.mission.profile) this.placeArrows();
  }

  // Block axes (x along the track, y to its right, z down) to the world, unstretched.
  toWorld(x, y, z) {
    const c = Math.cos(this.block.azimuth), s = Math.sin(this.block.azimuth);
    return [c * x - s * y, -(s * x + c * y), -z];
  }

  buildWater() {
    const { low, high } = this.block, { palette, floor } = this.mission;
    const local = (x, y, z) => Vector.sub(this.toWorld(x, y, z), this.centre);
    const sides = [[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]];
    this.corners = [0, high[2]].flatMap(z => sides.map(([x, y]) => this.toWorld(x, y, z)));
    this.walls = sides.map(([x, y], k) => {
      const [u, v] = sides[(k + 1) % 4], shape = new Shape();
      for (let i = 0; i + 1 < palette.water.length; i++) {
        const [[s, ...top], [t, ...under]] = [palette.water[i], palette.water[i + 1]];
        const [a, b] = [s * high[2], t * high[2]];
        shape.quad(local(x, y, a), local(u, v, a), local(u, v, b), local(x, y, b),
          [[...top, 1], [...top, 1], [...under, 1], [...under, 1]]);
      }
      const middle = this.toWorld((x + u) / 2, (y + v) / 2, 0);
      return { mesh: shape.upload(this.renderer), middle,
        outward: Vector.sub(middle, this.centre) };
    });
    const bottom = new Shape(), deepest = [...palette.water.at(-1).slice(1), 1];
    bottom.quad(...sides.map(([x, y]) => local(x, y, high[2])), deepest);
    this.bottom = bottom.upload(this.renderer);
    const chart = new Shape(), [light, dark] = [2, 3].map(k => palette.water.at(k).slice(1));
    const wide = 40 * Math.max(high[0] - low[0], high[1] - low[1]);
    chart.quad([-wide, -wide, -high[2]], [wide, -wide, -high[2]], [wide, wide, -high[2]], [-wide, wide, -high[2]],
      [...light.map((c, k) => 0.4 * c + 0.6 * dark[k]), 1]);
    this.chart = chart.upload(this.renderer);
    const lid = new Shape();
    lid.quad(...sides.map(([x, y]) => local(x, y, 0)), [0.75, 0.93, 1, 0.2]);
    this.lid = lid.upload(this.renderer);
    const open = new Shape(), far = 400;
    open.quad([-far, -far, 0], [far, -far, 0], [far, far, 0], [-far, far, 0], [0.6, 0.85, 0.95, 0.35]);
    this.openLid = open.upload(this.renderer);
    this.edges = this.renderer.path({
      north: [0, 1, 2, 3, 0].map(k => this.corners[k][0]),
      west: [0, 1, 2, 3, 0].map(k => this.corners[k][1]), depth: [0, 0, 0, 0, 0] });
    this.levels = [];
    const step = niceStep(high[2] / 4);
    for (let d = step; d < 0.97 * high[2]; d += step) this.levels.push(d);
    this.levelPaths = this.walls.map((_, k) => this.levels.map(d => {
      const ends = [k, (k + 1) % 4].map(i => this.corners[i]);
      return this.renderer.path({
        north: ends.map(e => e[0]), west: ends.map(e => e[1]), depth: [d, d] });
    }));
    this.ground = floor ? this.buildGround(unpack(floor.depths), floor.count) : null;
  }

  // The sea floor as the top of a block of ground; depths (n, n) over the block, north first.
  buildGround(depths, n) {
    const { low, high } = this.block, sand = this.mission.palette.sand, shape = new Shape();
    const at = (i, j) => {
      const d = Math.min(depths[i * n + j], high[2]);
      return Vector.sub(this.toWorld(low[0] + (high[0] - low[0]) * i / (n - 1),
        high[1] - (high[1] - low[1]) * j / (n - 1), d), this.centre);
    };
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

  buildVehicle() {
    this.bodies = this.mission.vehicle.bodies.map(body => {
      const [places, normals, tint] = [body.corners, body.normals, body.tint].map(unpack);
      const solid = { places: [], normals: [], colours: [] }, glass = { places: [], normals: [], colours: [] };
      tint.forEach((k, i) => {
        const colour = body.tints[k], part = colour[3] < 1 ? glass : solid;
        for (let j = 9 * i; j < 9 * i + 9; j++) { part.places.push(places[j]); part.normals.push(normals[j]); }
        part.colours.push(...colour, ...colour, ...colour);
      });
      const mesh = part => part.places.length
        ? this.renderer.mesh(part.places, part.normals, part.colours) : null;
      return { ...body, solid: mesh(solid), glass: mesh(glass) };
    });
  }

  // Where the current's arrows stand: at round depths on a mast where the track leaves most room,
  // or along the track.
  placeArrows() {
    const { profile } = this.mission, { low, high } = this.block;
    const { north, east, depth, current_north: cn, current_east: ce } = this.page.recording.channels;
    const size = [high[0] - low[0], high[1] - low[1]], long = Math.max(...size);
    this.perSpeed = ARROW_SHARE * long / profile.strongest;
    const room = size.map(s => Math.min(1.2 * ARROW_SHARE * long, 0.3 * s));
    const feet = [low[0] + room[0], high[0] - room[0]].flatMap(
      x => [low[1] + room[1], high[1] - room[1]].map(y => this.toWorld(x, y, 0)));
    const stride = Math.max(1, Math.floor(north.length / 500));
    const gapOf = foot => {
      let least = Infinity;
      for (let i = 0; i < north.length; i += stride) {
        least = Math.min(least, Math.hypot(north[i] - foot[0], -east[i] - foot[1]));
      }
      return least;
    };
    this.foot = feet.reduce((best, foot) => gapOf(foot) > gapOf(best) ? foot : best);
    this.mast = [];
    if (!profile.averaged) {
      const deepest = profile.depth.at(-1), step = niceStep(Math.max(deepest, 1) / 11);
      for (let d = step / 2; d <= deepest; d += step) this.mast.push(d);
      if (this.mastPath) this.renderer.forget(this.mastPath);
      this.mastPath = this.renderer.path({ north: [this.foot[0], this.foot[0]],
        west: [this.foot[1], this.foot[1]], depth: [0, high[2]] });
    }
    this.along = [];
    if (!cn) return;
    const lengths = new Float64Array(north.length), count = 16;
    for (let i = 1; i < north.length; i++) {
      lengths[i] = lengths[i - 1] + Math.hypot(north[i] - north[i - 1], east[i] - east[i - 1]);
    }
    for (let k = 0; k < count; k++) {
      const where = locate(lengths, (k + 0.5) / count * lengths.at(-1));
      const [n, e, d, u, v] = [north, east, depth, cn, ce].map(values => between(values, where));
      if (Number.isFinite(u + v)) this.along.push({ place: [n, -e, -d], current: [u, v] });
    }
  }

  // Least and largest north and west [m] of all tracks; of a live mission, which is not known yet,
  // of the block.
  get extent() {
    if (this.bounds) return this.bounds;
    const bounds = [Infinity, -Infinity, Infinity, -Infinity];
    const widen = (north, west) => {
      bounds[0] = Math.min(bounds[0], north); bounds[1] = Math.max(bounds[1], north);
      bounds[2] = Math.min(bounds[2], west); bounds[3] = Math.max(bounds[3], west);
    };
    if (this.mission.live) for (const [north, west] of this.corners) widen(north, west);
    const { north, east } = this.page.recording.channels;
    north.forEach((n, i) => widen(n, -east[i]));
    for (const track of this.mission.tracks) {
      const [n, e] = [unpack(track.north), unpack(track.east)];
      n.forEach((value, i) => widen(value, -e[i]));
    }
    this.bounds = bounds;
    return bounds;
  }

  currentAt(depth) {
    const { depth: depths, north, east } = this.mission.profile;
    if (depths.length < 2) return [north[0], east[0]];
    const where = locate(depths, clamp(depth, depths[0], depths.at(-1)));
    return [between(north, where), between(east, where)];
  }

  // --- cameras -----------------------------------------------------------------------------

  show(name) {
    this.name = name;
    this.stretch = name === "chase" ? 1 : this.block.stretch;
    this.drawn = null;
    this.hand = { bearing: 0, elevation: 0, zoom: 1, move: [0, 0, 0] };
    this.page.touch();
  }

  place(state, elapsed, jumped) {
    const camera = this.camera, { wide, high } = this.shown, { hand } = this;
    camera.aspect = wide / high;
    camera.parallel = this.name === "map";
    if (this.name === "chase") {
      const heading = state.heading;
      const behind = jumped || calm || this.heading === undefined ? 0 : Math.exp(-elapsed / CHASE.lag);
      this.heading = jumped || this.heading === undefined
        ? heading : heading + behind * wrapped(this.heading - heading);
      camera.half = Math.tan(WIDE);
      camera.bearing = -(this.heading * RADIANS + CHASE.bearing) + hand.bearing;
      camera.elevation = clamp(CHASE.elevation + hand.elevation, -1.45, 1.5);
      const fit = Math.max(1, 1.1 / camera.aspect);
      camera.distance = clamp(CHASE.lengths * this.mission.vehicle.length * fit / hand.zoom, 1.2, 80);
      camera.focus = Vector.add(this.vehiclePlace(state), hand.move);
      camera.near = 0.05 * camera.distance;
      camera.far = 1500;
      return;
    }
    const broadside = -(this.block.azimuth + Math.PI / 2), corners = this.corners.map(c => this.stretched(c));
    const narrow = wide < 640;
    // Shares of half the picture, for title, legend, labels and buttons.
    const margin = narrow ? { left: 0.3, right: 0.1, top: 0.5, bottom: 0.36 }
      : { left: 0.18, right: 0.14, top: 0.2, bottom: 0.26 };
    camera.half = Math.tan(NARROW);
    if (this.name === "map") {
      camera.bearing = Math.PI;
      camera.elevation = Math.PI / 2;
      const [south, farNorth, east, west] = this.extent, { left, right, top, bottom } = margin;
      const half = Math.max((farNorth - south) / 2 / (1 - (top + bottom) / 2),
        (west - east) / 2 / (camera.aspect * (1 - (left + right) / 2)), 6);
      const up = half * (margin.top - margin.bottom) / 2;
      const deep = this.block.high[2] * this.stretch;
      camera.half = half / hand.zoom;
      camera.focus = Vector.add([(south + farNorth) / 2 + up, (east + west) / 2, 0], hand.move);
      camera.distance = 10 + 2 * half + deep;
      camera.near = 1;
      camera.far = camera.distance + 4 * deep + 100;
      return;
    }
    camera.bearing = broadside + (this.name === "orbit" ? 32 * RADIANS : 0);
    camera.elevation = (this.name === "orbit" ? 24 : 9) * RADIANS;
    camera.fit(corners, margin);
    camera.bearing += hand.bearing;
    camera.elevation = clamp(camera.elevation + hand.elevation, -1.5, 1.55);
    const whole = camera.distance;
    camera.focus = Vector.add(camera.focus, hand.move);
    camera.distance /= hand.zoom;
    camera.near = Math.max(0.05, 0.02 * camera.distance);
    camera.far = 6 * whole + camera.distance;
  }

  stretched(place) { return [place[0], place[1], place[2] * this.stretch]; }

  vehiclePlace(state) { return [state.north, -state.east, -state.depth * this.stretch]; }

  // How many times as large as it is the vehicle is drawn, so that it is always seen.
  magnification(place) {
    if (this.name === "chase") return 1;
    const { camera, shown } = this, { length } = this.mission.vehicle;
    const along = camera.parallel ? 1 : Math.max(
      Vector.dot(Vector.sub(place, camera.eye()), camera.axes().forward), 0.1);
    const pixelsPerMetre = shown.high / (2 * camera.half * along);
    const wanted = Math.max(VEHICLE_SHARE * shown.wide, LEAST_PIXELS);
    return Math.max(1, wanted / (length * pixelsPerMetre));
  }

  listen() {
    const { canvas } = this, fingers = new Map();
    const spread = () => {
      const [a, b] = [...fingers.values()];
      return { x: (a.x + b.x) / 2, y: (a.y + b.y) / 2, long: Math.hypot(a.x - b.x, a.y - b.y) };
    };
    canvas.addEventListener("pointerdown", event => {
      canvas.setPointerCapture(event.pointerId);
      fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    });
    for (const end of ["pointerup", "pointercancel"]) {
      canvas.addEventListener(end, event => fingers.delete(event.pointerId));
    }
    canvas.addEventListener("pointermove", event => {
      const before = fingers.get(event.pointerId);
      if (!before) return;
      const old = fingers.size === 2 ? spread() : null;
      fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
      if (old) {
        const now = spread();
        this.shift(now.x - old.x, now.y - old.y);
        this.zoom(now.long / Math.max(old.long, 1), now.x, now.y);
      } else if (fingers.size === 1) {
        const [dx, dy] = [event.clientX - before.x, event.clientY - before.y];
        if (this.name === "map" || event.shiftKey || event.buttons === 2) this.shift(dx, dy);
        else {
          this.hand.bearing -= dx * 0.006;
          this.hand.elevation += dy * 0.006;
        }
      }
      this.page.touch();
    });
    canvas.addEventListener("contextmenu", event => event.preventDefault());
    canvas.addEventListener("wheel", event => {
      event.preventDefault();
      this.zoom(Math.exp(-clamp(event.deltaY, -240, 240) * 0.0016), event.clientX, event.clientY);
      this.page.touch();
    }, { passive: false });
    canvas.addEventListener("dblclick", () => this.page.chooseCamera(this.name));
    canvas.addEventListener("webglcontextlost", event => event.preventDefault());
    canvas.addEventListener("webglcontextrestored", () => location.reload());
  }

  // Metres of one pixel at the focus.
  get metresPerPixel() {
    const { camera } = this;
    return 2 * camera.half * (camera.parallel ? 1 : camera.distance) / this.shown.high;
  }

  shift(dx, dy) {
    const { right, up } = this.camera.axes(), k = this.metresPerPixel;
    this.hand.move = Vector.add(this.hand.move, Vector.add(
      Vector.scale(right, -dx * k), Vector.scale(up, dy * k)));
  }

  // Nearer by a factor, towards the place under the pointer.
  zoom(factor, x, y) {
    const before = this.hand.zoom, frame = this.canvas.getBoundingClientRect();
    this.hand.zoom = clamp(before * factor, this.name === "chase" ? 0.05 : 0.3, 20000);
    const share = 1 - before / this.hand.zoom;
    if (this.name !== "chase") {
      this.shift(-(x - frame.left - frame.width / 2) * share, -(y - frame.top - frame.height / 2) * share);
    }
  }

  // --- drawing -----------------------------------------------------------------------------

  draw(state, elapsed, jumped) {
    this.shown = fitCanvas(this.canvas);
    this.place(state, elapsed, jumped);
    const { renderer, camera, name, shown } = this, open = name === "chase";
    const px = shown.ratio * clamp(shown.wide / 900, 0.6, 1);  // lines are thinner on a phone
    const here = this.vehiclePlace(state), [now, part] = state.where;
    renderer.begin(camera, this.stretch, open);
    const eye = camera.eye(), block = { place: this.centre, stretched: true, flat: 1 };
    if (open) {
      if (this.ground) renderer.drawMesh(this.ground, { ...block, flat: 0 });
    } else {
      if (name !== "map") {
        this.walls.forEach(({ mesh, middle, outward }, k) => {
          if (Vector.dot(Vector.sub(eye, middle), outward) > 0) return;
          renderer.drawMesh(mesh, block);
          for (const path of this.levelPaths[k]) {
            renderer.drawPath(path, { wide: 1.8 * px, colour: [0.5, 0.72, 0.86] });
          }
        });
      }
      if (eye[2] > -this.block.high[2] * this.stretch) {
        renderer.drawMesh(name === "map" ? this.chart : this.bottom, block);
      }
      if (this.ground) renderer.drawMesh(this.ground, { ...block, flat: 0.15 });
      const ground = this.mission.palette.sand.map(c => 0.3 * c);
      if (name !== "map") renderer.drawPath(this.track, { wide: 2 * px, onFloor: true,
        lift: 0.004 * this.block.high[2] * this.stretch,
        colour: this.ground ? ground : [0.01, 0.05, 0.14] });
      if (name !== "map") renderer.drawPath(this.edges, { wide: 2 * px, colour: [0.92, 0.98, 1] });
    }
    if (this.withCurrents && this.mission.profile) this.drawCurrents(state, open);
    const size = this.magnification(here);
    renderer.drawPath(this.track, { now, part, future: true, wide: 1.6 * px, colour: this.mission.palette.future });
    for (const other of this.others) {
      const [k, share] = locate(other.times, state.time);
      if (state.time > other.times[0]) {
        renderer.drawPath(other.path, { now: k, part: share, wide: 3.2 * px, colour: other.colour });
      }
    }
    // Behind the hull, not through it.
    renderer.drawPath(this.track, { now, part, wide: (open ? 7 : 5) * px, hull: here,
      clear: open ? TAIL * this.mission.vehicle.length : 0 });
    this.drawVehicle(state, here, size);
    if (!open && name !== "map") renderer.drawMesh(this.lid, { ...block, blend: true });
    if (open) {
      renderer.drawMesh(this.openLid, { place: [here[0], here[1], 0], blend: true, flat: 1 });
    }
    this.drawMarks(state, here, size);
  }

  // Where each body is from the hull's middle, and how it is turned, at true size.
  bodyPoses(state) {
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

  drawVehicle(state, here, size) {
    const poses = this.bodyPoses(state);
    for (const blend of [false, true]) {
      this.bodies.forEach((body, k) => {
        const mesh = blend ? body.glass : body.solid, { place, turn } = poses[k];
        if (mesh) {
          this.renderer.drawMesh(mesh, { place: Vector.add(here, Vector.scale(place, size)), turn, size,
            shine: 0.35, blend, murk: 0.25 });
        }
      });
    }
  }

  drawArrow(place, [north, east], perSpeed, least) {
    const speed = Math.hypot(north, east), long = speed * perSpeed;
    if (long < least) return;
    this.renderer.drawMesh(this.arrow, {
      place, turn: Turn.about([0, 0, 1], Math.atan2(-east, north)), size: long, murk: 0.3 });
  }

  drawCurrents(state, open) {
    this.ladder = [];
    if (open) {
      const { profile } = this.mission, heading = state.heading * RADIANS;
      const c = Math.cos(heading), s = Math.sin(heading), [ahead, aside] = [0.2, -3 * Math.min(1, this.camera.aspect)];
      const x = state.north + ahead * c - aside * s, y = -state.east - (ahead * s + aside * c);
      const levels = profile.averaged ? [state.depth] : [];
      for (let d = Math.ceil(state.depth - 2.6); !profile.averaged && d <= state.depth + 2.6; d++) levels.push(d);
      for (const d of levels) {
        if (d < 0) continue;
        const flow = profile.averaged ? [state.current_north, state.current_east] : this.currentAt(d);
        if (!Number.isFinite(flow[0])) continue;
        const place = [x, y, -d];
        this.ladder.push([d, place]);
        this.drawArrow(place, flow, LONGEST_LADDER / profile.strongest, 0.02);
      }
      return;
    }
    const least = 6 * this.metresPerPixel;
    if (this.mast.length && this.name !== "map") {
      this.renderer.drawPath(this.mastPath, { wide: 2 * this.shown.ratio, colour: [0.85, 0.92, 0.96] });
      for (const d of this.mast) {
        this.drawArrow([this.foot[0], this.foot[1], -d * this.stretch], this.currentAt(d), this.perSpeed, least);
      }
    } else {
      for (const { place, current } of this.along) {
        this.drawArrow(this.stretched(place), current, 0.7 * this.perSpeed, least);
      }
    }
  }

  // Words over the picture: depths, distances, scale, north, and what is not at true scale.
  drawMarks(state, here, size) {
    const { marks, camera, name } = this, { wide, high, ratio } = fitCanvas(marks);
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
    if (name === "chase") {
      for (const [d, place] of this.withCurrents ? this.ladder || [] : []) put(place, metres(d), -12, 4, "right");
    } else {
      const corners = this.corners.map(c => this.stretched(c)), { low, high: top } = this.block;
      if (name !== "map") {
        const tops = corners.slice(0, 4).map(c => at(c)?.[0] ?? Infinity), left = tops.indexOf(Math.min(...tops));
        for (const d of this.levels) {
          put([corners[left][0], corners[left][1], -d * this.stretch], metres(d), -8, 4, "right");
        }
        put(corners[left], "0 m", -8, 4, "right");
      }
      const eye = camera.eye(), deep = name === "map" ? 0 : top[2];
      const away = y => Vector.length(Vector.sub(
        this.stretched(this.toWorld((low[0] + top[0]) / 2, y, deep)), eye));
      const y = away(low[1]) < away(top[1]) ? low[1] : top[1], long = top[0] - low[0];
      if (name !== "map") {
        const step = niceStep(long / (wide < 640 ? 3 : 5));
        for (let d = 0; d <= long; d += step) {
          put(this.stretched(this.toWorld(low[0] + d, y, deep)), d ? metres(d) : "0", 0, 20, "center");
        }
      }
    }
    const { right, up } = camera.axes();
    drawCompass(context, 40, compassTop(), Math.atan2(-up[0], right[0]));
    if (name === "map") drawScaleBar(context, 1 / this.metresPerPixel, wide, high);
    const facts = [];
    if (name !== "map" && this.stretch !== 1) facts.push(`depth × ${+this.stretch.toPrecision(2)}`);
    if (size > 1.5) facts.push(`vehicle × ${+size.toPrecision(2)}`);
    if (wide >= 640) facts.push(...this.mission.facts);
    const words = facts.join(" · ");
    if (words !== this.drawn) { $("facts").textContent = words; this.drawn = words; }
  }
}
