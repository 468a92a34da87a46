"use strict";
// Format: numbers, times and places as words, and the readouts of a mission.

const UNKNOWN = "–", MINUS = "−";
const MONTHS = ["Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec"];
const DAY = 86400;
const TIME_STEPS = [1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 10800, 21600, 43200,
  ...[1, 2, 5, 10, 20, 50, 100, 200, 500, 1000].map(days => days * DAY)];  // [s]

function plain(value, digits) {
  const text = value.toFixed(digits);
  return Number(text) === 0 ? text.replace("-", "") : text.replace("-", MINUS);
}

const signed = (value, digits) => (Number(value.toFixed(digits)) > 0 ? "+" : "") + plain(value, digits);
const metres = value => value >= 2000 ? `${+(value / 1000).toPrecision(4)} km` : `${+value.toPrecision(4)} m`;
const bearingOf = (north, east) => (Math.atan2(east, north) / RADIANS + 360) % 360;
const three = degrees => String(Math.round(degrees) % 360).padStart(3, "0");
const two = x => String(x).padStart(2, "0");

function clock(seconds) {
  const whole = Math.round(seconds);
  return `${Math.floor(whole / 3600)}:${two(Math.floor(whole / 60) % 60)}:${two(whole % 60)}`;
}

const moment = unix => new Date(1000 * unix).toISOString().replace("T", " ").slice(0, 19);

function buoyancy(mass) {
  if (Math.abs(mass) < 0.005) return "neutral";
  return `${mass >= 0 ? "▼" : "▲"} ${Math.abs(mass).toFixed(2)} kg`;
}

// Times [s] of round clock times, at most so many, and their words: of the day where the date is
// known, else since the mission's start.
function timeTicks([first, last], unix, most) {
  const step = TIME_STEPS.find(one => (last - first) / one <= most) ?? TIME_STEPS.at(-1), zero = unix ?? 0;
  const ticks = [];
  for (let k = Math.ceil((first + zero) / step); k * step <= last + zero; k++) {
    ticks.push([k * step - zero, (unix === null ? sinceStart : ofDay)(k * step, step)]);
  }
  return ticks;
}

function ofDay(unix, step) {
  const date = new Date(1000 * unix).toISOString();
  if (unix % DAY === 0) return `${+date.slice(8, 10)} ${MONTHS[+date.slice(5, 7) - 1]}`;
  return date.slice(11, step < 60 ? 19 : 16);
}

function sinceStart(time, step) {
  if (step >= DAY) return `${time / DAY} d`;
  return step < 60 ? clock(time) : clock(time).slice(0, -3);
}

// Latitude and longitude [degree] of a place [m] north and east of the start, as twin.geodesy has
// it: of the plane that touches the Earth there, or along meridian and parallel.
function geographic(place, north, east) {
  const { latitude, longitude, meridian, normal, convergence } = place;
  if (convergence === null) {
    const turned = north / meridian / RADIANS, middle = (latitude + turned / 2) * RADIANS;
    return [latitude + turned, longitude + east / (normal * Math.cos(middle)) / RADIANS];
  }
  const along = north - 0.5 * convergence * east ** 2, across = east * (1 + north * convergence);
  return [latitude + along / meridian / RADIANS,
    longitude + across / (normal * Math.cos(latitude * RADIANS)) / RADIANS];
}

// Degrees and minutes, as pilots and GPS receivers write them.
function degrees(value, [plus, minus]) {
  const minutes = Math.round(Math.abs(value) * 60000);
  return `${Math.floor(minutes / 60000)}° ${((minutes % 60000) / 1000).toFixed(3)}′ ${value < 0 ? minus : plus}`;
}

function position(place, north, east) {
  const [latitude, longitude] = geographic(place, north, east);
  return `${degrees(latitude, "NS")}, ${degrees(wrapped(longitude), "EW")}`;
}

// Name, explanation, the channels it needs, and its text; an angle that is only drawn has none.
function readouts({ mission, channels }) {
  const speed = v => `${plain(v, 2)} m/s`;
  const list = [
    ["depth", "depth below the surface", ["depth"], now => `${plain(now.depth, 1)} m`],
    ["pitch", "bow up is positive", ["pitch"], now => `${signed(now.pitch, 1)}°`],
    ["roll", "starboard down is positive", ["roll"], now => `${signed(now.roll, 1)}°`],
    ["heading", "true heading of the bow", ["heading"], now => `${three(now.heading)}°`],
    ["surge", "speed forward through the water", ["surge"], now => speed(now.surge)],
    ["speed", "speed through the water", ["speed"], now => speed(now.speed)],
    ["over ground", "horizontal speed over ground", ["ground_speed"], now => speed(now.ground_speed)],
    ["net buoyancy", "▼ heavy, ▲ light", ["net_mass"], now => buoyancy(now.net_mass)],
    ["pumped", "volume that the pump displaces", ["pumped"], now => `${signed(now.pumped, 0)} cm³`],
    ["current", "speed of the current and where it goes", ["current_north", "current_east"],
      now => `${speed(Math.hypot(now.current_north, now.current_east))} → `
        + `${three(bearingOf(now.current_north, now.current_east))}°`],
    ["altitude", "height above the sea floor", ["bottom"], now => `${plain(now.bottom - now.depth, 1)} m`],
  ];
  for (const { name, kind } of mission.parts) {
    const title = name.replaceAll("_", " ");
    const words = {
      spins: now => `${plain(now[name], 0)} rad/s`,
      turns: now => `${signed(now[name] / RADIANS, 1)}°`,
      slides: now => `${signed(1000 * now[name], 0)} mm`,
    }[kind];
    list.push([title, `position of the ${title}`, [name], words]);
  }
  if (mission.unix !== null) {
    list.unshift(["date, UTC", "", ["time"], now => moment(mission.unix + now.time)]);
  }
  if (mission.place !== null) {
    list.push(["position", "latitude and longitude, WGS84", ["north", "east"],
      now => position(mission.place, now.north, now.east)]);
  }
  return list.filter(([, , needed]) => needed.every(
    name => name in channels && !mission.unknown.includes(name)));
}
