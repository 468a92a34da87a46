"use strict";
// Page: the moment that is shown, what plays, and who draws it.

const calm = matchMedia("(prefers-reduced-motion: reduce)").matches;
const TOLD = 2500;                                     // ms that a remark stays
const REST = 150;                                      // ms after which a hasty picture is drawn again

// With which share of the screen's pixels pictures that follow each other are drawn, so that they
// come fast enough on a slow machine too.
const pace = { share: 1, mean: 30, counted: 0 };

// Milliseconds from one picture to the next.
function measurePace(interval) {
  pace.mean += 0.25 * (Math.min(interval, 200) - pace.mean);
  if (++pace.counted < 4) return;
  const slower = pace.mean > 42 && pace.share > 0.5, faster = pace.mean < 20 && pace.share < 1;
  if (!slower && !faster) return;
  Object.assign(pace, { share: clamp(pace.share * (slower ? 0.75 : 1.33), 0.5, 1), mean: 30, counted: 0 });
}

class Page {
  constructor(mission) {
    this.mission = mission;
    this.recording = new Recording(mission);
    this.items = readouts(this.recording);
    this.time = this.recording.first;
    this.playing = false;
    this.stale = true;
    this.values = buildReadouts(this.items);
    this.speeds = buildTransport(this);
    buildLegend(mission);
    const keys = keysOf(this);
    this.actions = Object.assign({}, ...keys.map(([, , actions]) => actions));
    buildHelp(keys, mission.notes);
    this.strip = new Strip($("strip"), this);
    try {
      this.scene = new Scene($("scene"), $("marks"), this);
    } catch (error) {
      this.scene = new FlatMap($("marks"), this);
      const alert = `No three dimensions here (${error.message}): the track is shown from above.`;
      Object.assign($("alert"), { hidden: false, textContent: `${alert} A browser with WebGL2 shows all.` });
    }
    this.buttons = buildCameras(this);
    addEventListener("resize", () => this.touch());
    addEventListener("keydown", event => this.key(event));
    addEventListener("hashchange", () => this.obeyAddress());
    matchMedia("(prefers-color-scheme: light)").addEventListener("change", () => this.strip.forget());
    this.seek(mission.opening.time ?? this.recording.first);
    this.scene.show?.(mission.opening.camera);
    this.obeyAddress();
    this.markButtons();
    requestAnimationFrame(now => this.frame(now));
  }

  // #t=600&camera=chase&play=1 after the address opens the page at that moment.
  obeyAddress() {
    const words = new URLSearchParams(location.hash.slice(1));
    if (words.has("t") && Number.isFinite(Number(words.get("t")))) this.seek(Number(words.get("t")));
    if (CAMERAS.includes(words.get("camera"))) this.chooseCamera(words.get("camera"));
    if (words.has("play")) this.setPlaying(words.get("play") !== "0");
  }

  touch() { this.stale = true; }

  // A remark that goes away by itself.
  tell(words) {
    clearTimeout(this.telling);
    Object.assign($("told"), { hidden: false, textContent: words });
    this.telling = setTimeout(() => { $("told").hidden = true; }, TOLD);
  }

  // --- time ----------------------------------------------------------------------------------

  seek(time) {
    this.time = clamp(time, this.recording.first, this.recording.last);
    this.jumped = true;
    this.touch();
  }

  // To the next surfacing, or with -1 to the one before.
  surface(way) {
    const { surfacings } = this.recording, { time } = this;
    const found = way > 0 ? surfacings.find(one => one > time + 1e-6)
      : surfacings.findLast(one => one < time - 1e-6);
    if (found === undefined) this.tell(`no ${way > 0 ? "later" : "earlier"} surfacing`);
    else this.seek(found);
  }

  setPlaying(playing) {
    if (playing && this.time >= this.recording.last && !this.live?.running) this.seek(this.recording.first);
    this.playing = playing;
    $("play").textContent = playing ? "Pause" : "Play";
    this.touch();
  }

  setSpeed(speed) {
    this.speed = speed;
    $("speed").value = speed;
  }

  // A mission that is flown now: ask its server for what came since, twice a second.
  async follow() {
    this.live = { running: true, state: "live" };
    this.setPlaying(true);
    while (this.live.running) {
      try {
        const answer = await fetch(
          `rows?from=${this.recording.times.length}`, { method: "POST" });
        const { channels, running, problem } = await answer.json();
        if (channels) {
          const begun = this.recording.times.length > 2;
          this.recording.append(channels);
          // Who comes more than a second late joins the mission where it is.
          if (!begun && this.recording.last - this.time > this.speed) this.seek(this.recording.last);
          this.scene.extend?.();
          this.strip.forget();
        }
        this.live.running = running;
        this.live.state = problem || (running ? "live" : `of ${clock(this.recording.last)}`);
      } catch {
        this.live = { running: false, state: "the server has ended" };
      }
      this.touch();
      await new Promise(done => setTimeout(done, 500));
    }
  }

  // Whether what is shown was flown some seconds ago.
  get behind() { return this.recording.last - this.time > 3 * this.speed; }

  // --- drawing -------------------------------------------------------------------------------

  frame(now) {
    const interval = now - (this.before ?? now), elapsed = Math.min(interval / 1000, 0.25);
    this.before = now;
    if (this.playing) {
      this.time = Math.min(this.time + elapsed * this.speed, this.recording.last);
      if (this.time >= this.recording.last && !this.live?.running) this.setPlaying(false);
      this.touch();
    }
    if (this.stale) {
      if (this.moving) measurePace(interval);
      this.draw(elapsed, this.moving ? pace.share : 1);
      this.drawn = now;
    } else if (this.hasty && now - this.drawn > REST) this.draw(0, 1);
    this.moving = this.drawn === now;
    requestAnimationFrame(later => this.frame(later));
  }

  draw(elapsed, share) {
    const state = this.recording.at(this.time);
    this.stale = false;
    this.hasty = share < 1;
    this.scene.draw(state, elapsed, this.jumped, share);
    this.jumped = false;
    this.strip.draw();
    this.write(state);
  }

  write(state) {
    const unknown = state.gap > 0;
    this.values.time.textContent = clock(this.time);
    for (const [name, , needed, words] of this.items) {
      const known = (!unknown || name.startsWith("date")) && needed.every(one => Number.isFinite(state[one]));
      this.values[name].textContent = known ? words(state) : UNKNOWN;
    }
    const slider = $("slider");
    slider.value = this.time;
    slider.setAttribute("aria-valuetext", `${clock(this.time)}, depth ${plain(state.depth, 1)} metres`);
    $("moment").className = this.live?.running ? "" : "still";
    const late = this.live?.running && this.behind ? `, now at ${clock(this.recording.last)} (End)` : "";
    $("moment").textContent = this.live ? this.live.state + late : `of ${clock(this.recording.end)}`;
  }

  // --- choices -------------------------------------------------------------------------------

  chooseCamera(name) {
    this.scene.show?.(name);
    this.markButtons();
  }

  markButtons() {
    const { cameras = {}, switches = {} } = this.buttons ?? {};
    for (const [name, button] of Object.entries(cameras)) {
      button.setAttribute("aria-pressed", String(name === this.scene.name));
    }
    switches.follow?.setAttribute("aria-pressed", String(this.scene.following));
    switches.currents?.setAttribute("aria-pressed", String(this.scene.withCurrents));
    this.touch();
  }

  toggleFollowing() {
    if (this.scene instanceof FlatMap) return;
    if (this.scene.name === "chase") this.tell("the chase camera follows the vehicle always");
    else {
      this.scene.follow(!this.scene.following);
      this.markButtons();
    }
  }

  toggleCurrents() {
    if (!this.buttons.switches.currents) return;
    this.scene.withCurrents = !this.scene.withCurrents;
    this.markButtons();
  }

  toggleHelp(open = !$("helping").open) { $("helping").open = open; }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const focused = document.activeElement;
    if (focused instanceof HTMLSelectElement) return;
    const action = this.actions[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!action || (event.key === " " && focused?.closest("button, summary"))) return;
    event.preventDefault();
    action(event);
  }
}

globalThis.page = new Page(JSON.parse($("mission").textContent));
if (page.mission.live) page.follow();
