"use strict";
// Space: vectors, rotations, the camera, and the hand that moves it.
//
// World axes: x north, y west, z up, metres; depth is stretched by the vertical exaggeration.

const Vector = {
  add: (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]],
  sub: (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]],
  scale: (a, k) => [a[0] * k, a[1] * k, a[2] * k],
  dot: (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2],
  cross: (a, b) => [
    a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]],
  length: a => Math.hypot(a[0], a[1], a[2]),
};

// Quaternions (w, x, y, z), as MuJoCo has them.
const Turn = {
  times: (a, b) => [
    a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
    a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
    a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
    a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0]],
  about: (axis, angle) => {
    const s = Math.sin(angle / 2);
    return [Math.cos(angle / 2), axis[0] * s, axis[1] * s, axis[2] * s];
  },
  apply: (q, v) => {
    const u = [q[1], q[2], q[3]], t = Vector.scale(Vector.cross(u, v), 2);
    return Vector.add(Vector.add(v, Vector.scale(t, q[0])), Vector.cross(u, t));
  },
  // Roll, pitch, heading [rad] of the field (NED, FRD) as a rotation of the z-up hull.
  fromEuler: (roll, pitch, heading) => Turn.times(
    Turn.about([0, 0, 1], -heading), Turn.times(
      Turn.about([0, 1, 0], -pitch), Turn.about([1, 0, 0], roll))),
};

// A camera that looks at `focus` from `distance` along a bearing (from north towards west) and an
// elevation [rad]; parallel ones see `half` metres up and down from the middle.
class Camera {
  constructor() {
    Object.assign(this, {
      focus: [0, 0, 0], bearing: 0, elevation: 0.4, distance: 10, half: Math.tan(0.244),
      parallel: false, near: 0.1, far: 1000, aspect: 1 });
  }

  axes() {
    const c = Math.cos(this.bearing), s = Math.sin(this.bearing);
    const ce = Math.cos(this.elevation), se = Math.sin(this.elevation);
    const forward = [-c * ce, -s * ce, -se], up = [-c * se, -s * se, ce];
    return { forward, up, right: Vector.cross(forward, up) };
  }

  eye() { return Vector.sub(this.focus, Vector.scale(this.axes().forward, this.distance)); }

  // Places relative to the eye to clip space, column by column.
  matrix() {
    const { forward: f, up: u, right: r } = this.axes(), { near: n, far: z } = this;
    const y = 1 / this.half, x = y / this.aspect;
    if (this.parallel) {
      const d = -2 / (z - n), e = -(z + n) / (z - n);
      return new Float32Array([
        x * r[0], y * u[0], -d * f[0], 0, x * r[1], y * u[1], -d * f[1], 0,
        x * r[2], y * u[2], -d * f[2], 0, 0, 0, e, 1]);
    }
    const d = (z + n) / (z - n), e = -2 * z * n / (z - n);
    return new Float32Array([
      x * r[0], y * u[0], d * f[0], f[0], x * r[1], y * u[1], d * f[1], f[1],
      x * r[2], y * u[2], d * f[2], f[2], 0, 0, e, 0]);
  }

  // Picture coordinates of a place: x and y from -1 to 1 (up), and the distance along the view.
  project(place) {
    const { forward, up, right } = this.axes(), p = Vector.sub(place, this.eye());
    const along = Vector.dot(p, forward), by = this.parallel ? 1 : along;
    return [
      Vector.dot(p, right) / (by * this.half * this.aspect), Vector.dot(p, up) / (by * this.half),
      this.parallel ? along + this.distance : along];
  }

  // Move so that all points fill the picture between margins, shares of its half width and height.
  fit(points, margin) {
    const { forward, up, right } = this.axes();
    const wide = this.half * this.aspect * (1 - (margin.left + margin.right) / 2);
    const high = this.half * (1 - (margin.top + margin.bottom) / 2);
    const middle = points.reduce(Vector.add).map(sum => sum / points.length);
    let target = middle, distance = 1;
    for (let round = 0; round < 20; round++) {
      const seen = points.map(p => Vector.sub(p, target)).map(
        p => [Vector.dot(p, right), Vector.dot(p, up), Vector.dot(p, forward)]);
      distance = Math.max(1e-3, ...seen.map(
        ([x, y, z]) => Math.max(Math.abs(x) / wide, Math.abs(y) / high) - z));
      const xs = seen.map(([x, , z]) => x / (distance + z));
      const ys = seen.map(([, y, z]) => y / (distance + z));
      const x = (Math.max(...xs) + Math.min(...xs)) / 2, y = (Math.max(...ys) + Math.min(...ys)) / 2;
      target = Vector.add(target, Vector.add(
        Vector.scale(right, distance * x), Vector.scale(up, distance * y)));
    }
    // The free part's middle is not the picture's where the margins differ.
    const shift = Vector.add(
      Vector.scale(right, distance * this.half * this.aspect * (margin.right - margin.left) / 2),
      Vector.scale(up, distance * this.half * (margin.top - margin.bottom) / 2));
    this.focus = Vector.add(target, shift);
    this.distance = distance;
  }
}

const TURN = 0.006, WHEEL = 0.0016;                    // radians of a pixel; zoom of a wheel's pixel

// Follow a mouse or fingers on a canvas: what one presses or drags by so many pixels, what two
// pinch (their middle, their distance, and that across), and how much farther a wheel goes.
function followFingers(canvas, { press = () => {}, drag, pinch, wheel }) {
  const fingers = new Map(), put = event => fingers.set(event.pointerId, [event.clientX, event.clientY]);
  const spread = () => {
    const [[a, b], [c, d]] = [...fingers.values()];
    return { x: (a + c) / 2, y: (b + d) / 2, long: Math.hypot(a - c, b - d), wide: Math.abs(a - c) };
  };
  canvas.addEventListener("pointerdown", event => {
    canvas.setPointerCapture(event.pointerId);
    put(event);
    if (fingers.size === 1) press(event);
  });
  for (const end of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(end, event => fingers.delete(event.pointerId));
  }
  canvas.addEventListener("pointermove", event => {
    const before = fingers.get(event.pointerId);
    if (!before) return;
    const old = fingers.size === 2 ? spread() : null;
    put(event);
    if (old) pinch(old, spread());
    else if (fingers.size === 1) drag(event.clientX - before[0], event.clientY - before[1], event);
  });
  canvas.addEventListener("wheel", event => {
    event.preventDefault();
    wheel(Math.exp(clamp(event.deltaY, -240, 240) * WHEEL), event);
  }, { passive: false });
}

class Hand {
  // `scene` has name, canvas, camera, shown and metresPerPixel, and is told when something moved.
  constructor(scene) {
    this.scene = scene;
    this.reset();
    this.listen(scene.canvas);
  }

  reset() { Object.assign(this, { bearing: 0, elevation: 0, zoomed: 1, move: [0, 0, 0] }); }

  listen(canvas) {
    const { page } = this.scene;
    followFingers(canvas, {
      drag: (dx, dy, event) => {
        if (this.scene.name === "map" || event.shiftKey || event.buttons === 2) this.shift(dx, dy);
        else {
          this.bearing -= dx * TURN;
          this.elevation += dy * TURN;
        }
        page.touch();
      },
      pinch: (old, now) => {
        this.shift(now.x - old.x, now.y - old.y);
        this.zoom(now.long / Math.max(old.long, 1), now.x, now.y);
        page.touch();
      },
      wheel: (farther, event) => {
        this.zoom(1 / farther, event.clientX, event.clientY);
        page.touch();
      },
    });
    canvas.addEventListener("contextmenu", event => event.preventDefault());
    canvas.addEventListener("dblclick", () => page.chooseCamera(this.scene.name));
  }

  // By pixels of the picture.
  shift(dx, dy) {
    const { right, up } = this.scene.camera.axes(), k = this.scene.metresPerPixel;
    this.move = Vector.add(this.move, Vector.add(Vector.scale(right, -dx * k), Vector.scale(up, dy * k)));
  }

  // Nearer by a factor, towards the place under the pointer; towards the vehicle that is followed.
  zoom(factor, x, y) {
    const { scene } = this, chase = scene.name === "chase", before = this.zoomed;
    this.zoomed = clamp(before * factor, chase ? 0.05 : 0.3, 20000);
    if (chase || scene.following) return;
    const share = 1 - before / this.zoomed, frame = scene.canvas.getBoundingClientRect();
    this.shift(-(x - frame.left - frame.width / 2) * share, -(y - frame.top - frame.height / 2) * share);
  }
}
