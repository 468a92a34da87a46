"use strict";
// Bodies: the vehicle with its moving parts, and the arrows of the current.

class VehicleBodies {
  constructor(renderer, bodies) {
    this.renderer = renderer;
    this.bodies = bodies.map(body => {
      const [places, normals, tint] = [body.corners, body.normals, body.tint].map(unpack);
      const solid = { places: [], normals: [], colours: [] }, glass = { places: [], normals: [], colours: [] };
      tint.forEach((k, i) => {
        const colour = body.tints[k], part = colour[3] < 1 ? glass : solid;
        for (let j = 9 * i; j < 9 * i + 9; j++) { part.places.push(places[j]); part.normals.push(normals[j]); }
        part.colours.push(...colour, ...colour, ...colour);
      });
      const mesh = part => part.places.length
        ? renderer.mesh(part.places, part.normals, part.colours) : null;
      return { ...body, solid: mesh(solid), glass: mesh(glass) };
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

  // Again when a live mission has gone on.
  arrange(channels) {
    this.along = channels.current_north ? this.alongTrack(channels, 16) : [];
  }

  // Places and currents at equal distances along the track.
  alongTrack({ north, east, depth, current_north: cn, current_east: ce }, count) {
    const lengths = new Float64Array(north.length), found = [];
    for (let i = 1; i < north.length; i++) {
      lengths[i] = lengths[i - 1] + Math.hypot(north[i] - north[i - 1], east[i] - east[i - 1]);
    }
    for (let k = 0; k < count; k++) {
      const where = locate(lengths, (k + 0.5) / count * lengths.at(-1));
      const [n, e, d, u, v] = [north, east, depth, cn, ce].map(values => between(values, where));
      if (Number.isFinite(u + v)) found.push({ place: [n, -e, -d], current: [u, v] });
    }
    return found;
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
