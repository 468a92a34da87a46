"use strict";
// Scene: one mission in three dimensions, seen by one of its cameras.

const CAMERAS = ["orbit", "side", "map", "chase"];
const CAMERA_TITLES = {
  orbit: "the whole track from one side and above", side: "across the track",
  map: "from above, north up", chase: "behind the vehicle, at true scale" };
const NARROW = 14 * RADIANS, WIDE = 24 * RADIANS;      // half of the vertical field of view
const CHASE = { bearing: 142 * RADIANS, elevation: 16 * RADIANS, lengths: 2.06, lag: 1.2 };
const ARROW_SHARE = 0.13, LONGEST_LADDER = 1.0;        // of the block's length; metres
const TAIL = 0.47;                                     // of the hull's length, behind its middle
const VEHICLE_SHARE = 0.085, LEAST_PIXELS = 84;        // of the picture's width
const FOLLOW_ZOOM = 6;                                 // when following begins

class Scene {
  constructor(canvas, marks, page) {
    const { mission } = page;
    Object.assign(this, { canvas, marks, page, mission, name: "orbit", withCurrents: true, following: false });
    this.block = mission.block;
    this.camera = new Camera();
    this.renderer = new Renderer(canvas, mission.palette);
    this.renderer.setScale(mission.scale.colours);
    this.water = new Water(this.renderer, mission);
    this.vehicle = new VehicleBodies(this.renderer, mission.vehicle.bodies);
    this.currents = mission.profile ? new CurrentArrows(this.renderer, mission) : null;
    this.others = mission.tracks.map(track => {
      const [time, n, e, depth] = ["time", "north", "east", "depth"].map(name => unpack(track[name]));
      return { colour: track.colour,
        track: new Track(this.renderer, { time, north: n, west: e.map(x => -x), depth }, this.block.stretch) };
    });
    this.extend();
    this.hand = new Hand(this);
    canvas.addEventListener("webglcontextlost", event => event.preventDefault());
    canvas.addEventListener("webglcontextrestored", () => location.reload());
  }

  // The track as far as it is known; again when a live mission has gone on.
  extend() {
    const { time, north, east, depth, colour, gap, bottom } = this.page.recording.channels;
    const deep = this.block.high[2], { steps } = this.mission.scale;
    const points = { time, north, west: east.map(e => -e), depth, gap,
      colour: colour.map(c => Number.isNaN(c) ? -1 : c / steps),
      floor: bottom ? bottom.map(b => Math.min(b, deep)) : depth.map(() => deep) };
    if (this.track) {
      this.track.extend(points);
      this.flatTrack?.extend(points);
    } else this.track = new Track(this.renderer, points, this.block.stretch);
    this.currents?.arrange(this.page.recording.channels);
  }

  // Least and largest north and west [m] of all tracks; of a live mission, which is not known yet,
  // of the block.
  get extent() {
    if (this.bounds) return this.bounds;
    const boxes = [this.track, ...this.others.map(other => other.track)].flatMap(track => track.boxes);
    const places = boxes.flatMap(({ low, high }) => [low, high]);
    if (this.mission.live) places.push(...this.water.corners);
    const [norths, wests] = [0, 1].map(k => places.map(place => place[k]));
    this.bounds = [Math.min(...norths), Math.max(...norths), Math.min(...wests), Math.max(...wests)];
    return this.bounds;
  }

  // --- cameras -----------------------------------------------------------------------------

  show(name) {
    this.name = name;
    this.stretch = name === "chase" ? 1 : this.block.stretch;
    this.facts = null;
    this.hand.reset();
    if (this.following) this.hand.zoomed = FOLLOW_ZOOM;
    this.page.touch();
  }

  // Keep the vehicle in the middle of the picture, or no longer.
  follow(following) {
    this.following = following;
    this.show(this.name);
  }

  place(state, elapsed, jumped) {
    const { camera } = this, { wide, high } = this.shown;
    camera.aspect = wide / high;
    camera.parallel = this.name === "map";
    if (this.name === "chase") this.placeBehind(state, elapsed, jumped);
    else if (this.name === "map") this.placeAbove();
    else this.placeBeside();
    if (this.name !== "chase" && this.following) {
      camera.focus = Vector.add(this.vehiclePlace(state), this.hand.move);
    }
  }

  placeBehind(state, elapsed, jumped) {
    const { camera, hand } = this, { heading } = state;
    const behind = jumped || calm || this.heading === undefined ? 0 : Math.exp(-elapsed / CHASE.lag);
    this.heading = jumped || this.heading === undefined
      ? heading : heading + behind * wrapped(this.heading - heading);
    camera.half = Math.tan(WIDE);
    camera.bearing = -(this.heading * RADIANS + CHASE.bearing) + hand.bearing;
    camera.elevation = clamp(CHASE.elevation + hand.elevation, -1.45, 1.5);
    const fit = Math.max(1, 1.1 / camera.aspect);
    camera.distance = clamp(CHASE.lengths * this.mission.vehicle.length * fit / hand.zoomed, 1.2, 80);
    camera.focus = Vector.add(this.vehiclePlace(state), hand.move);
    camera.near = 0.05 * camera.distance;
    camera.far = 1500;
  }

  // Shares of half the picture, for title, legend, labels and buttons.
  get margin() {
    const { wide, high } = this.shown, bottom = clamp(2 * (clearBottom() + 22) / high, 0.26, 0.8);
    return wide < 640 ? { left: 0.3, right: 0.1, top: 0.5, bottom } : { left: 0.18, right: 0.14, top: 0.2, bottom };
  }

  placeAbove() {
    const { camera, hand } = this, [south, farNorth, east, west] = this.extent;
    const { left, right, top, bottom } = this.margin, deep = this.block.high[2] * this.stretch;
    const half = Math.max((farNorth - south) / 2 / (1 - (top + bottom) / 2),
      (west - east) / 2 / (camera.aspect * (1 - (left + right) / 2)), 6);
    const up = half * (top - bottom) / 2;
    camera.bearing = Math.PI;
    camera.elevation = Math.PI / 2;
    camera.half = half / hand.zoomed;
    camera.focus = Vector.add([(south + farNorth) / 2 + up, (east + west) / 2, 0], hand.move);
    camera.distance = 10 + 2 * half + deep;
    camera.near = 1;
    camera.far = camera.distance + 4 * deep + 100;
  }

  placeBeside() {
    const { camera, hand } = this, orbit = this.name === "orbit";
    camera.half = Math.tan(NARROW);
    camera.bearing = -(this.block.azimuth + Math.PI / 2) + (orbit ? 32 * RADIANS : 0);
    camera.elevation = (orbit ? 24 : 9) * RADIANS;
    camera.fit(this.water.corners.map(c => this.stretched(c)), this.margin);
    camera.bearing += hand.bearing;
    camera.elevation = clamp(camera.elevation + hand.elevation, -1.5, 1.55);
    const whole = camera.distance;
    camera.focus = Vector.add(camera.focus, hand.move);
    camera.distance /= hand.zoomed;
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

  // Metres of one pixel at the focus.
  get metresPerPixel() {
    const { camera } = this;
    return 2 * camera.half * (camera.parallel ? 1 : camera.distance) / this.shown.high;
  }

  // --- drawing -----------------------------------------------------------------------------

  // With a share of the screen's pixels: fewer where the machine is slow.
  draw(state, elapsed, jumped, share = 1) {
    this.shown = fitCanvas(this.canvas, 2, share);
    this.place(state, elapsed, jumped);
    const { renderer, camera, name, shown, water } = this, open = name === "chase";
    if (name === "map") this.flatTrack ??= new Track(renderer, this.track.points, 0);
    const track = name === "map" ? this.flatTrack : this.track;  // from above depth is not seen
    const px = shown.ratio * clamp(shown.wide / 900, 0.6, 1);  // lines are thinner on a phone
    const here = this.vehiclePlace(state), eye = camera.eye(), { time } = state;
    renderer.begin(camera, this.stretch, open);
    const lost = share < 1 ? 2 * LOST_PIXELS : LOST_PIXELS;
    const look = (one, withFloor) => one.look(camera, this.stretch, this.canvas.height,
      { open, withFloor, lost: withFloor ? 2 * lost : lost });
    if (open) water.drawOpenGround();
    else water.drawBehind(name, eye, this.stretch, px);
    if (!open && name !== "map") this.drawShadow(look, px);
    if (this.withCurrents && this.currents) {
      if (open) this.currents.drawLadder(state, camera.aspect);
      else this.currents.drawBlock(name, this.stretch, this.metresPerPixel, 2 * shown.ratio);
    }
    look(track, false);
    track.draw({ wide: 1.6 * px, colour: this.mission.palette.future }, time, true);
    for (const other of this.others) {
      look(other.track, false);
      other.track.draw({ wide: 3.2 * px, colour: other.colour }, time);
    }
    // Behind the hull, not through it.
    track.draw({ wide: (open ? 7 : 5) * px, hull: here, clear: open ? TAIL * this.mission.vehicle.length : 0 }, time);
    const size = this.magnification(here);
    this.vehicle.draw(state, here, size);
    water.drawSurface(name, here);
    drawLabels(this, state, size);
  }

  // The track down at the floor.
  drawShadow(look, px) {
    const colour = this.water.ground ? this.mission.palette.sand.map(c => 0.3 * c) : [0.01, 0.05, 0.14];
    look(this.track, true);
    this.track.draw({ wide: 2 * px, onFloor: true, colour, lift: 0.004 * this.block.high[2] * this.stretch });
  }
}
