"use strict";
// Hand: how a mouse or fingers turn, move and zoom the camera of a scene.

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
