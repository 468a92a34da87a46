"use strict";
// Hand: how a mouse or fingers turn, move and zoom the camera of a scene.

const TURN = 0.006, WHEEL = 0.0016;                    // radians of a pixel; zoom of a wheel's pixel

class Hand {
  // `scene` has name, canvas, camera, shown and metresPerPixel, and is told when something moved.
  constructor(scene) {
    this.scene = scene;
    this.reset();
    this.listen(scene.canvas);
  }

  reset() { Object.assign(this, { bearing: 0, elevation: 0, zoomed: 1, move: [0, 0, 0] }); }

  listen(canvas) {
    const fingers = new Map();
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
        if (this.scene.name === "map" || event.shiftKey || event.buttons === 2) this.shift(dx, dy);
        else {
          this.bearing -= dx * TURN;
          this.elevation += dy * TURN;
        }
      }
      this.scene.page.touch();
    });
    canvas.addEventListener("contextmenu", event => event.preventDefault());
    canvas.addEventListener("wheel", event => {
      event.preventDefault();
      this.zoom(Math.exp(-clamp(event.deltaY, -240, 240) * WHEEL), event.clientX, event.clientY);
      this.scene.page.touch();
    }, { passive: false });
    canvas.addEventListener("dblclick", () => this.scene.page.chooseCamera(this.scene.name));
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
