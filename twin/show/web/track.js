"use strict";
// Track: a line of many points, of which each picture draws those that it can show.
//
// A point's weight is the detail [m] that is lost without it, after Douglas and Peucker (1973,
// doi:10.3138/FM57-6770-U75U-7727): how far the track is from the place at the same time on the
// straight line between the points that stay. What a picture cannot show, half a pixel, is left
// out. The track is cut into chunks, so that near ones have more detail than far ones.

const CHUNK = 1024;                                    // points
const LEVELS = [0, ...Array.from({ length: 18 }, (_, k) => 0.05 * 2 ** k)];  // m of detail; 0 is all
const LOST_PIXELS = 0.5;
const COLOUR_SHARE = 0.25;  // metres lost by a metre of line whose colour is wrong by the whole scale
const CLEAR_WATER = 400;    // m, through which a line is still seen in open water

class Track {
  // Points {time, north, west, depth, floor, colour, gap}, arrays of equal length; the last three
  // may be missing, and a colour of -1 is unknown. Weights are of depths stretched so many times.
  constructor(renderer, points, stretch) {
    Object.assign(this, { renderer, points, stretch, levels: [], weight: new Float32Array(0) });
    this.extend(points);
  }

  // The same points and more.
  extend(points) {
    const known = Math.max(Math.floor((this.weight.length - 1) / CHUNK), 0) * CHUNK;
    for (const level of this.levels) if (level) this.renderer.forget(level.path);
    const weight = new Float32Array(points.north.length);
    weight.set(this.weight.subarray(0, known));
    Object.assign(this, { points, weight, levels: [] });
    const last = weight.length - 1, { gap } = points;
    this.edges = [];
    for (let k = 0; k < last; k += CHUNK) this.edges.push(k);
    this.edges.push(last);
    let from = known;
    for (let k = known; k <= last; k++) {
      const turned = gap && k > known && k < last
        && ((gap[k] > 0.5) !== (gap[k - 1] > 0.5) || (gap[k] > 0.5) !== (gap[k + 1] > 0.5));
      if (!turned && k % CHUNK !== 0 && k !== last) continue;
      weight[k] = Infinity;
      this.weigh(from, k);
      from = k;
    }
    this.boxes = this.edges.slice(1).map((end, c) => this.box(this.edges[c], end));
  }

  weigh(first, last) {
    const { time, north, west, depth, floor, colour } = this.points, { weight, stretch } = this;
    const stack = [[first, last, Infinity]];
    while (stack.length) {
      const [a, b, most] = stack.pop(), per = time[b] > time[a] ? 1 / (time[b] - time[a]) : 0;
      const [n, w, d] = [north[b] - north[a], west[b] - west[a], depth[b] - depth[a]];
      const across = COLOUR_SHARE * Math.hypot(n, w, d * stretch);
      let far = 0, worst = -1;
      for (let i = a + 1; i < b; i++) {
        const s = (time[i] - time[a]) * per;
        const x = north[i] - north[a] - s * n, y = west[i] - west[a] - s * w;
        const z = (depth[i] - depth[a] - s * d) * stretch;
        let lost = Math.sqrt(x * x + y * y + z * z);
        if (floor) lost = Math.max(lost, stretch * Math.abs(floor[i] - floor[a] - s * (floor[b] - floor[a])));
        if (colour) {
          const wrong = Math.abs(colour[i] - colour[a] - s * (colour[b] - colour[a]));
          lost = Math.max(lost, across * Math.min(wrong, 1));
        }
        if (lost > far) { far = lost; worst = i; }
      }
      if (worst < 0) continue;
      weight[worst] = Math.min(far, most);               // not needed before its neighbours
      stack.push([a, worst, weight[worst]], [worst, b, weight[worst]]);
    }
  }

  // Least and largest north, west, depth of points, and of the sea floor below them.
  box(first, last) {
    const { north, west, depth, floor } = this.points;
    const low = [north[first], west[first], depth[first]], high = [...low];
    let deep = floor ? floor[first] : -Infinity;
    for (let i = first; i <= last; i++) {
      if (north[i] < low[0]) low[0] = north[i]; else if (north[i] > high[0]) high[0] = north[i];
      if (west[i] < low[1]) low[1] = west[i]; else if (west[i] > high[1]) high[1] = west[i];
      if (depth[i] < low[2]) low[2] = depth[i]; else if (depth[i] > high[2]) high[2] = depth[i];
      if (floor && floor[i] > deep) deep = floor[i];
    }
    return { low, high, deep: Math.max(deep, high[2]) };
  }

  // The line of a level, made when it is first drawn: which points, and where its chunks begin.
  level(k) {
    if (this.levels[k]) return this.levels[k];
    const kept = [], starts = [];
    let chunk = 0;
    for (let i = 0; i < this.weight.length; i++) {
      if (i > 0 && i < this.weight.length - 1 && this.weight[i] < LEVELS[k]) continue;
      if (i === this.edges[chunk]) { starts.push(kept.length); chunk++; }
      kept.push(i);
    }
    return this.levels[k] = { kept, starts, path: this.renderer.path(this.points, kept) };
  }

  // Choose what the camera sees, at the level that it needs for so many lost pixels; with the line
  // down at the floor where asked.
  look(camera, stretch, high, { open = false, withFloor = false, lost = LOST_PIXELS } = {}) {
    const { forward, up, right } = camera.axes(), eye = camera.eye();
    const sides = [[right, camera.half * camera.aspect], [up, camera.half]];
    this.seen = [];
    this.boxes.forEach((box, chunk) => {
      const bottom = withFloor ? box.deep : box.high[2];
      const middle = [(box.low[0] + box.high[0]) / 2, (box.low[1] + box.high[1]) / 2,
        -stretch * (box.low[2] + bottom) / 2];
      const radius = Math.hypot(box.high[0] - box.low[0], box.high[1] - box.low[1],
        stretch * (bottom - box.low[2])) / 2;
      const p = Vector.sub(middle, eye), along = Vector.dot(p, forward);
      if (!camera.parallel && along < -radius) return;
      if (open && Vector.length(p) - radius > CLEAR_WATER) return;
      for (const [axis, half] of sides) {
        const away = Math.abs(Vector.dot(p, axis));
        const beyond = camera.parallel ? away - half : (away - along * half) / Math.hypot(1, half);
        if (beyond > 1.02 * radius + 0.02 * half) return;
      }
      const near = camera.parallel ? 1 : Math.max(Vector.length(p) - radius, camera.near);
      const detail = lost * 2 * camera.half * near / high;
      let level = LEVELS.length - 1;
      while (LEVELS[level] > detail) level--;
      this.seen.push([chunk, level]);
    });
  }

  // What `look` chose, up to a time, from it on, or all where there is none.
  draw(look, time = null, future = false) {
    let run = null;
    const flush = () => {
      if (run) this.renderer.drawPath(run.path, { ...look, ...run, future });
      run = null;
    };
    for (const [chunk, k] of this.seen) {
      const { kept, starts, path } = this.level(k), times = this.points.time;
      let first = starts[chunk], end = starts[chunk + 1], cut = -1, part = 1;
      if (time !== null) {
        const [begins, ends] = [times[kept[first]], times[kept[end]]];
        if (future ? time >= ends : time <= begins) continue;
        if (time > begins && time < ends) {
          let high = end;
          cut = first;
          while (high - cut > 1) {
            const middle = (cut + high) >> 1;
            if (times[kept[middle]] <= time) cut = middle; else high = middle;
          }
          part = (time - times[kept[cut]]) / (times[kept[cut + 1]] - times[kept[cut]]);
          if (future) first = cut; else end = cut + 1;
        }
      }
      if (run && run.path === path && run.first + run.count === first && !(future && cut >= 0)) {
        run.count += end - first;
      } else {
        flush();
        run = { path, first, count: end - first, cut: -1, part: 1 };
      }
      if (cut >= 0) Object.assign(run, { cut: cut - run.first, part });
    }
    flush();
  }
}
