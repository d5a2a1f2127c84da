// The page: aircraft that are dragged, the future that the policy makes of them, and its picture.
// Lengths are in required separations D, speeds in the ownship's greatest speed V, times in D / V, angles in rad from east.
"use strict";

const get = (id) => document.getElementById(id);
const MOST = 8, STEPS = 300, ACROSS = 16; // D across the shorter side of the map
const SMALLEST = 0.3; // D, of an area's radius, and of separations that policies are trained with
const CLOSING = 14, APART = 6; // px: a corner so near to the first closes a polygon; one so near to the last is none
const BUDGET = { future: 6, search: 8, map: 10 }; // ms of a frame until which each may work
const ICONS = { play: "M5 2.5v13l10.5-6.5z", pause: "M4 3h3.6v12H4zM10.4 3H14v12h-3.6z" };

const sky = { canvas: document.querySelector("#sky canvas"), box: get("sky") };
const chart = { canvas: document.querySelector("#chart canvas"), box: get("chart") };
const seek = document.querySelector("#chart input");
let type, aircraft, dt; // the chosen type in SI; without dimension; its time step
let start; // aircraft at time 0, the ownship first: {x, y, heading, speed, goalX, goalY}
let line, shown; // the future from there; the one that is drawn, while the new one is not ready
let time = 0, playing = false, chosen = -1, changed = true, held = null, last = 0, colours = {};
let areas = [], drawing = null; // to be kept out of; what the pointer draws: "disc", "polygon" or nothing
let corners = [], pointer = null; // of the polygon that is being drawn; where its next one would be
let map = null, search = null; // of turns; of other manoeuvres where the policy loses the separation

// ---- the future: what happens if nothing is moved ----

const everyone = () => document.querySelector("[name=decides]:checked").value === "all";
const decides = (index) => index === 0 || everyone();

function begin(planes) {
  const gone = planes.map(() => false);
  return { frames: [{ planes, gone, actions: planes.map(() => [0, 0]) }], least: { distance: Infinity }, done: false };
}

// Areas as the policy sees them: aircraft that stand still, with the radius of a disc as their separation.
const standing = () => areas.flatMap(discsOf).map(({ x, y, radius }) => ({ x, y, heading: 0, speed: 0, separation: Math.max(SMALLEST, radius) }));

// When in a step an aircraft that decides first enters an area; null: none does.
function entry(now, planes, all) {
  let first = null;
  for (let i = 0; i < (all ? planes.length : 1); i++) {
    for (const area of now.gone[i] ? [] : areas) {
      const part = entersAt(area, now.planes[i], now.actions[i], planes[i], dt, aircraft.limits);
      if (part !== null && !(first?.part <= part)) first = { part, index: i };
    }
  }
  return first;
}

function extend(future) {
  const { frames } = future, now = frames.at(-1), all = everyone();
  now.actions = now.planes.map((one, i) => {
    if (now.gone[i] || !(i === 0 || all)) return [0, 0];
    return command(one, [...now.planes.filter((_, k) => k !== i && !now.gone[k]), ...standing()], one.goalX, one.goalY, aircraft);
  });
  const planes = now.planes.map((one, i) => advance(one, now.actions[i], dt, aircraft.limits));
  now.distance = Infinity;
  for (let i = 0; i < (all ? planes.length : 1); i++) {
    for (let k = i + 1; k < planes.length; k++) {
      if (now.gone[i] || now.gone[k]) continue;
      const [distance, part] = closest(now.planes[i], planes[i], now.planes[k], planes[k], dt);
      now.distance = Math.min(now.distance, distance);
      if (distance < future.least.distance) future.least = { distance, time: frames.length - 1 + part, pair: [i, k] };
    }
  }
  const entered = future.entered ? null : entry(now, planes, all);
  if (entered) future.entered = { time: frames.length - 1 + entered.part, index: entered.index };
  const gone = planes.map((one, i) =>
    now.gone[i] || (decides(i) && Math.hypot(one.x - one.goalX, one.y - one.goalY) <= aircraft.goal_radius));
  frames.push({ planes, gone, actions: now.actions, distance: now.distance });
  future.done = frames.length > STEPS || (all ? gone.every(Boolean) : gone[0]);
}

// The aircraft between two steps.
function at(future, step) {
  const index = Math.min(Math.floor(step), future.frames.length - 1), frame = future.frames[index], part = step - index;
  if (part <= 0) return frame;
  return { ...frame, planes: frame.planes.map((one, i) => advance(one, frame.actions[i], part * dt, aircraft.limits)) };
}

const now = () => (changed ? { planes: start, gone: start.map(() => false), actions: start.map(() => [0, 0]) } : at(line, time));

// What is moved begins a new future, at time 0.
function edit(change) {
  start = now().planes.map((one) => ({ ...one }));
  change?.();
  changed = true;
  map = null;
  wake();
}

// ---- scenes ----

const tall = () => sky.box.clientHeight > sky.box.clientWidth;

function arrival(angle, radius, speed, aside = 0) { // of one that would be in the middle at the time radius
  const way = radius * speed, cosine = Math.cos(angle), sine = Math.sin(angle);
  const x = way * cosine - aside * sine, y = way * sine + aside * cosine;
  return { x, y, heading: angle + Math.PI, speed, goalX: -way * cosine, goalY: -way * sine };
}

const aside = () => 0.2 * Math.random() - 0.1;

function drawn() { // an intruder at random
  const { limits } = aircraft, pace = everyone() ? limits.speed_max : 1.1;
  const speed = limits.speed_min + Math.random() * (pace - limits.speed_min);
  return arrival(Math.PI * (1 + (0.25 + 1.5 * Math.random()) * (Math.random() < 0.5 ? -1 : 1)), 6.5, speed, Math.random() - 0.5);
}

function newScene() {
  const kind = get("scene").value, count = Number(get("count").value), slowest = aircraft.limits.speed_min;
  const fast = 0.5 * (1 + slowest), own = arrival(Math.PI, 7 / fast, fast);
  const first = {
    "head-on": () => [arrival(0.02, 7, 0.85, 0.15)],
    crossing: () => [arrival(1.5, 7 / fast, 0.9, 0.3)],
    overtaking: () => [arrival(Math.PI + 0.06, 3, slowest)],
    // Displaced a little: what is exactly symmetric stays so, as the policy is, and meets in the middle.
    sides: () => Array.from({ length: count }, (_, i) => arrival(Math.PI + (2 * Math.PI * (i + 1)) / (count + 1), 7 / fast, fast, aside())),
    random: () => [],
  }[kind]();
  if (kind === "overtaking") own.speed = 1;
  const planes = [own, ...first];
  for (let tries = 0; planes.length <= count && tries < 999; tries++) {
    const one = drawn(); // not nearer than two separations to another
    if (tries > 900 || planes.every((other) => Math.hypot(one.x - other.x, one.y - other.y) > 2)) planes.push(one);
  }
  start = planes.slice(0, count + 1);
  if (tall()) start = start.map((one) => ({ ...one, x: -one.y, y: one.x, goalX: -one.goalY, goalY: one.goalX, heading: one.heading + Math.PI / 2 }));
  start.forEach(limited);
  chosen = -1;
  changed = true;
  map = shown = null;
  grips();
  wake();
}

function limited(one, index) { // keeps an aircraft on the map and its speed within what it can fly
  const { width, height, scale } = view();
  one.x = clip(one.x, -width / 2 / scale + 0.4, width / 2 / scale - 0.4);
  one.y = clip(one.y, -height / 2 / scale + 0.4, height / 2 / scale - 0.4);
  one.heading = Math.atan2(Math.sin(one.heading), Math.cos(one.heading));
  const own = decides(index);
  one.speed = clip(one.speed, own ? aircraft.limits.speed_min : 0.3, own ? 1 : 1.5);
}

function choose(name) { // an aircraft type: its limits without dimension; scenes stay as they are
  type = WEIGHTS.aircraft[name];
  const { limits, separation } = type, top = limits.speed_max;
  aircraft = {
    separation: 1,
    goal_radius: type.goal_radius / separation,
    limits: {
      speed_min: limits.speed_min / top, speed_max: 1, yaw_rate_max: (limits.yaw_rate_max * separation) / top,
      acceleration_min: (limits.acceleration_min * separation) / top ** 2,
      acceleration_max: (limits.acceleration_max * separation) / top ** 2,
    },
  };
  dt = (type.dt * top) / separation;
}

// ---- numbers in words ----

const metres = (value) => `${Math.round(value * type.separation).toLocaleString("en").replaceAll(",", "\u202f")} m`;
const short = (value) => { // on an axis
  const length = value * type.separation;
  if (length === 0) return "0";
  return length >= 1000 ? `${Number((length / 1000).toFixed(1))} km` : `${Math.round(length)} m`;
};
const seconds = (step) => `${(step * type.dt).toFixed(0)} s`;

function news() {
  if (!line.done) return { first: "The policy is looking ahead …", second: "", kept: null };
  const { least, entered } = line;
  if (entered && (least.distance >= 1 || entered.time <= least.time)) {
    const who = entered.index ? `Intruder ${entered.index}` : "The ownship", when = seconds(entered.time);
    return { first: `${who} ${entered.time <= time ? "has entered" : "will enter"} an area after ${when}.`, second: "", kept: false };
  }
  const kept = least.distance >= 1, past = least.time <= time, required = `${metres(1)} are required.`;
  const [one, other] = least.pair, between = one ? ` between intruders ${one} and ${other}` : ` from intruder ${other}`;
  const pair = start.length === 2 ? "" : between;
  if (!kept) {
    const first = `Separation ${past ? "was" : "will be"} lost: ${metres(least.distance)}${pair} after ${seconds(least.time)}; ${required}`;
    return { first, second: alternatives(), kept };
  }
  const end = line.frames.length - 1, arrived = everyone() ? line.frames[end].gone.every(Boolean) : line.frames[end].gone[0];
  const goal = everyone() ? "All reach their goals" : "The goal is reached";
  const second = arrived ? `${goal} after ${seconds(end)}.` : `No goal within ${seconds(STEPS)}.`;
  return { first: `${past ? "Kept" : "Will keep"} ${metres(least.distance)}${pair}; ${required}`, second, kept };
}

// Whether another manoeuvre of the ownship would have kept the separation; nothing where the others react to it.
function alternatives() {
  if (!search) return ""; // nor are areas known to it
  const [own, ...others] = search.planes;
  if (others.some((one) => Math.hypot(one.x - own.x, one.y - own.y) < 1)) return "It is lost at the start already: no manoeuvre can keep it.";
  if (search.distance >= 1 && search.done) return `The policy misses a solution: ${inWords(search.best)} from the start keeps ${metres(search.distance)}.`;
  if (!search.done) return "Other manoeuvres are tried …";
  const best = `${inWords(search.best)}, keeps ${metres(search.distance)}.`;
  if (search.lost) return `No manoeuvre can keep it (proven); the best of ${CANDIDATES.length}, ${best}`;
  return `None of ${CANDIDATES.length} simple manoeuvres keeps it, others are not ruled out; the best, ${best}`;
}

function inWords({ turn, throttle }) {
  const degrees = Math.round((Math.abs(turn) * 180) / Math.PI), side = turn > 0 ? "left" : "right";
  const course = degrees ? `a turn of ${degrees}° to the ${side}` : "flying straight on";
  return course + ["", " at the greatest speed", " at the lowest speed"].at(throttle);
}

function tell(state) {
  const { first, second, kept } = news(), said = `${first} ${second}`;
  if (get("news").textContent !== said && !held) {
    const strong = document.createElement("b");
    strong.textContent = first;
    strong.style.color = kept === false ? "var(--lost)" : "";
    get("news").replaceChildren(strong, ` ${second}`);
  }
  const flown = line.frames.slice(0, Math.floor(time) + 1).map((frame) => frame.distance ?? Infinity);
  const least = Math.min(...flown);
  get("least").textContent = Number.isFinite(least) ? metres(least) : "–";
  get("least").style.color = least < 1 ? "var(--lost)" : "";
  const own = state.planes[0], [throttle, steering] = state.actions[0], rate = (steering * type.limits.yaw_rate_max * 180) / Math.PI;
  get("speed").textContent = `${Math.round(own.speed * type.limits.speed_max)} m/s`;
  get("turn").textContent = `${Math.abs(rate).toFixed(1)}°/s`;
  get("hand").textContent = Math.abs(rate) < 0.05 ? "Turn" : rate > 0 ? "Turn left" : "Turn right";
  const bar = (id, value) => Object.assign(get(id).style, {
    left: `${50 + 50 * Math.min(value, 0)}%`, width: `${50 * Math.abs(value)}%`,
  });
  bar("throttle", throttle);
  bar("steering", -steering);
  get("clock").textContent = seconds(time);
  seek.max = shown.frames.length - 1;
  seek.value = time;
  seek.setAttribute("aria-valuetext", seconds(time));
}

// ---- the picture ----

function view() {
  const width = sky.box.clientWidth, height = sky.box.clientHeight;
  return { width, height, scale: Math.min(width, height) / ACROSS };
}

const tint = (name, alpha) => airmap.tint(colours[name], alpha);

function draw() {
  const { pen, width, height } = airmap.fitted(sky), { scale } = view(), state = now();
  const place = (x, y) => [width / 2 + x * scale, height / 2 - y * scale];
  const stroke = (colour, thickness, dash = []) => airmap.stroke(pen, colour, thickness, dash);
  const circle = (x, y, radius) => airmap.circle(pen, ...place(x, y), radius * scale);
  const path = (points) => airmap.line(pen, points.map(([x, y]) => place(x, y)));
  pen.lineCap = pen.lineJoin = "round";

  pen.beginPath(); // a grid of two separations
  for (let x = (width / 2) % (2 * scale); x < width; x += 2 * scale) (pen.moveTo(x, 0), pen.lineTo(x, height));
  for (let y = (height / 2) % (2 * scale); y < height; y += 2 * scale) (pen.moveTo(0, y), pen.lineTo(width, y));
  stroke(colours.grid, 1);
  if (map?.image) {
    pen.imageSmoothingEnabled = true;
    pen.imageSmoothingQuality = "high";
    const { canvas, size } = map.image;
    pen.drawImage(canvas, 0, 0, canvas.width * size, canvas.height * size);
  }
  pen.beginPath();
  pen.moveTo(14, height - 14);
  pen.lineTo(14 + 2 * scale, height - 14);
  stroke(colours.soft, 1.5);
  pen.fillStyle = colours.soft;
  pen.font = "12px system-ui, 'Liberation Sans', sans-serif";
  pen.textAlign = "left";
  const long = 2 * type.separation;
  pen.fillText(long < 5000 ? `${long} m` : `${(long / 1000).toFixed(1)} km`, 14, height - 20);

  for (const area of areas) {
    if (area.corners) (path(cornersOf(area)), pen.closePath());
    else circle(area.x, area.y, area.radius);
    pen.fillStyle = tint("area", 0.14);
    pen.fill("evenodd");
    stroke(colours.area, 1.8);
    if (area.corners) for (const { x, y, radius } of discsOf(area)) (circle(x, y, radius), stroke(tint("area", 0.5), 1, [3, 4])); // what the policy sees
  }
  if (corners.length) { // a polygon that is being drawn
    path(pointer ? [...corners, pointer] : corners);
    stroke(colours.area, 1.8, [5, 5]);
    corners.forEach(([x, y], i) => {
      pen.beginPath();
      pen.arc(...place(x, y), i === 0 ? 6 : 3.5, 0, 2 * Math.PI);
      pen.fillStyle = i === 0 ? colours.sky : colours.area;
      pen.fill();
      stroke(colours.area, 1.8);
    });
  }
  const colourOf = (index) => (index === 0 ? "own" : "other");
  state.planes.forEach((one, i) => { // goals
    if (!decides(i) || state.gone[i]) return;
    circle(one.goalX, one.goalY, i === 0 ? aircraft.goal_radius : 0.12);
    if (i === 0) (pen.fillStyle = tint("goal", 0.12)), pen.fill();
    stroke(i === 0 ? colours.goal : tint("other", 0.5), 1.5);
    if (i === 0) circle(one.goalX, one.goalY, 0.07), (pen.fillStyle = colours.goal), pen.fill();
  });

  const step = Math.floor(time), ahead = changed || shown !== line ? shown.frames : line.frames.slice(step + 1);
  state.planes.forEach((_, i) => { // what is to come, and what was
    if (get("plan").checked && !state.gone[i]) {
      const to = ahead.filter((frame) => !frame.gone[i]).map((frame) => [frame.planes[i]?.x, frame.planes[i]?.y]);
      const from = shown === line && !changed ? [[state.planes[i].x, state.planes[i].y]] : [];
      path([...from, ...to]);
      stroke(tint(colourOf(i), i === 0 ? 0.85 : 0.45), i === 0 ? 2.2 : 1.6, [0.1, 6]);
    }
    if (changed || time === 0) return;
    const track = line.frames.slice(0, step + 1).filter((frame) => !frame.gone[i]).map((frame) => [frame.planes[i].x, frame.planes[i].y]);
    if (!state.gone[i]) track.push([state.planes[i].x, state.planes[i].y]);
    path(track);
    stroke(tint(colourOf(i), state.gone[i] ? 0.3 : i === 0 ? 0.75 : 0.5), i === 0 ? 2.6 : 2);
  });

  const { least } = shown; // the closest approach, to come or past
  if (least.pair && !changed && (get("plan").checked || least.time <= time)) {
    const [a, b] = least.pair.map((i) => at(shown, least.time).planes[i]);
    const colour = least.distance < 1 ? "lost" : least.time <= time ? "ink" : "soft";
    for (const one of [a, b]) circle(one.x, one.y, 0.5), stroke(tint(colour, 0.45), 1, [3, 4]);
    path([[a.x, a.y], [b.x, b.y]]);
    stroke(tint(colour, 0.8), 1.2);
    pen.font = "600 13px system-ui, 'Liberation Sans', sans-serif";
    pen.textAlign = "center";
    const around = [a, b, ...state.planes.filter((_, i) => !state.gone[i])].map((one) => place(one.x, one.y));
    const across = pen.measureText(metres(least.distance)).width;
    const [tx, ty] = airmap.clearPlace(place((a.x + b.x) / 2, (a.y + b.y) / 2), across, around, { width, height, disc: 0.5 * scale + 4 });
    airmap.text(pen, metres(least.distance), tx, ty, colours[colour], colours.sky);
  }

  const pairs = (i) => state.planes.map((_, k) => k).filter((k) => k !== i && !state.gone[k] && (everyone() || i === 0 || k === 0));
  const size = clip(scale / 26, 0.75, 1.35);
  for (let i = state.planes.length - 1; i >= 0; i--) {
    if (state.gone[i]) continue;
    const one = state.planes[i], [x, y] = place(one.x, one.y);
    const near = Math.min(...pairs(i).map((k) => Math.hypot(one.x - state.planes[k].x, one.y - state.planes[k].y)));
    const colour = near < 1 ? "lost" : colourOf(i);
    circle(one.x, one.y, 0.5);
    pen.fillStyle = tint(colour, near < 1 ? 0.22 : 0.1);
    pen.fill();
    stroke(tint(colour, near < 1.3 ? 1 : 0.55), near < 1.3 ? 2 : 1.3);
    if (i === chosen) {
      const [tx, ty] = tipOf(one, place);
      pen.beginPath();
      pen.moveTo(x, y);
      pen.lineTo(tx, ty);
      stroke(tint(colourOf(i), 0.8), 1.5);
      pen.beginPath();
      pen.arc(tx, ty, 5.5, 0, 2 * Math.PI);
      pen.fillStyle = colours.sky;
      pen.fill();
      stroke(colours[colourOf(i)], 2);
    }
    airmap.plane(pen, x, y, one.heading, size, colours[colourOf(i)], colours.sky);
    if (i > 0 && start.length > 2) {
      pen.font = "11px system-ui, 'Liberation Sans', sans-serif";
      pen.textAlign = "center";
      pen.fillStyle = tint("ink", 0.65);
      pen.fillText(i, x - (0.5 * scale + 9) * Math.cos(one.heading), y + (0.5 * scale + 9) * Math.sin(one.heading) + 4);
    }
  }
  moveGrips(state, place);
  drawChart();
  return state;
}

function tipOf(one, place) { // the end of an aircraft's arrow: farther where it is faster
  const [x, y] = place(one.x, one.y), reach = 34 + 34 * one.speed;
  return [x + reach * Math.cos(one.heading), y - reach * Math.sin(one.heading)];
}

// The distance to the nearest aircraft over time. The axis is that of the square root, so that what is near is seen.
function drawChart() {
  const { pen, width, height } = airmap.fitted(chart), { frames } = shown, count = Math.max(frames.length - 1, 1);
  const far = Math.max(4, ...frames.map((frame) => frame.distance).filter(Number.isFinite));
  const left = 48, right = width - 8, top = 22, bottom = height - 18;
  const x = (step) => left + ((right - left) * step) / count;
  const y = (distance) => bottom - (bottom - top) * Math.sqrt(Math.min(distance / far, 1));
  const rule = (x0, y0, x1, y1) => (pen.beginPath(), pen.moveTo(x0, y0), pen.lineTo(x1, y1), pen.stroke());
  pen.font = "11px system-ui, 'Liberation Sans', sans-serif";
  pen.lineWidth = 1;
  pen.setLineDash([]);
  pen.fillStyle = tint("lost", 0.09);
  pen.fillRect(left, y(1), right - left, bottom - y(1));
  pen.textAlign = "right";
  for (const root of [0, 1, 2, 3, 4].filter((root) => root * root <= far)) { // evenly spaced on this axis
    pen.strokeStyle = root === 0 ? colours.soft : colours.line;
    rule(left, y(root * root), right, y(root * root));
    pen.fillStyle = colours.soft;
    pen.fillText(short(root * root), left - 6, y(root * root) + 4);
  }
  const whole = count * type.dt, apart = [5, 10, 20, 30, 60, 120, 300].find((one) => (whole / one) * 44 < right - left) ?? 600;
  pen.textAlign = "center";
  for (let moment = 0; moment <= whole; moment += apart) {
    const place = x(moment / type.dt);
    pen.strokeStyle = colours.soft;
    rule(place, bottom, place, bottom + 4);
    pen.fillText(`${moment} s`, clip(place, left, width - 16), height - 3);
  }
  const curve = (to) => {
    pen.beginPath();
    let drawing = false; // no line where no aircraft is left
    for (let step = 0; step <= to; step++) {
      const { distance } = frames[step], known = Number.isFinite(distance);
      if (known) pen[drawing ? "lineTo" : "moveTo"](x(step), y(distance));
      drawing = known;
    }
    pen.stroke();
  };
  pen.lineJoin = "round";
  pen.lineWidth = 2;
  pen.strokeStyle = tint("own", 0.4);
  curve(frames.length - 1);
  const step = Math.min(Math.floor(time), frames.length - 1);
  pen.strokeStyle = colours.own;
  curve(step);
  pen.lineWidth = 1;
  pen.strokeStyle = tint("lost", 0.8);
  pen.setLineDash([4, 4]);
  rule(left, y(1), right, y(1));
  pen.setLineDash([]);
  pen.strokeStyle = tint("ink", 0.5);
  rule(x(time), top - 4, x(time), bottom);
  if (Number.isFinite(frames[step].distance)) {
    pen.beginPath();
    pen.arc(x(time), y(frames[step].distance), 4.5, 0, 2 * Math.PI);
    pen.fillStyle = colours.own;
    pen.fill();
  }
  pen.fillStyle = colours.soft;
  pen.textAlign = "left";
  pen.fillText(`distance to the nearest${width < 320 ? "" : ` aircraft, ${metres(1)} required`}`, left, 10);
}

// ---- the map of turns: coarse first, then finer; smooth between the places that were asked ----

const FINEST = 8, LEVELS = [4, 2, 1]; // px between two places; times that

function colourMap(until) {
  if (!get("map").checked || start.length < 2) return (map = null);
  const state = now(), { width, height, scale } = view();
  const key = JSON.stringify([state.planes, areas, width, height, chosen]);
  if (!map || (map.key !== key && map.level > 0)) {
    const [own, ...others] = state.planes;
    const away = (one) => Math.hypot(one.x - own.x, one.y - own.y);
    const rest = others.filter((_, i) => !state.gone[i + 1]);
    if (state.gone[0] || !rest.length) return null;
    const moved = others[chosen - 1] ?? rest.reduce((a, b) => (away(a) < away(b) ? a : b));
    map = { key, image: map?.image, level: 0, own, moved, rest: rest.filter((one) => one !== moved), scale, width, height };
    beginLevel();
  }
  while (map.level < LEVELS.length && performance.now() < until) {
    const { size, work, next } = map, column = next % work.width, row = Math.floor(next / work.width);
    const x = ((column + 0.5) * size - map.width / 2) / map.scale, y = (map.height / 2 - (row + 0.5) * size) / map.scale;
    const [, turn] = command(map.own, [{ ...map.moved, x, y }, ...map.rest, ...standing()], map.own.goalX, map.own.goalY, aircraft);
    map.pen.globalAlpha = 0.42 * Math.abs(turn);
    map.pen.fillStyle = colours[turn > 0 ? "left" : "right"];
    map.pen.fillRect(column, row, 1, 1);
    map.next += 1;
    if (map.next === work.width * work.height) {
      map.image = { canvas: work, size };
      map.level += 1;
      beginLevel();
    }
  }
  return map.level < LEVELS.length || map.key !== key;
}

function beginLevel() { // a pixel for each place that is asked
  if (map.level === LEVELS.length) return;
  const size = FINEST * LEVELS[map.level];
  const work = Object.assign(document.createElement("canvas"), { width: Math.ceil(map.width / size), height: Math.ceil(map.height / size) });
  Object.assign(map, { size, work, pen: work.getContext("2d"), next: 0 });
}

// ---- grips: what can be taken by finger, mouse or keyboard ----

function grips() {
  const group = get("grips");
  const grip = (label, index, part) => {
    const button = document.createElement("button");
    button.className = `grip ${part}`;
    Object.assign(button.dataset, { index, part });
    if (part === "tip") button.tabIndex = -1;
    button.style.zIndex = { tip: 20, plane: 10 - index, goal: 0, area: 0 }[part];
    button.setAttribute("aria-label", label);
    button.addEventListener("pointerdown", take);
    button.addEventListener("pointermove", drag);
    for (const name of ["pointerup", "pointercancel"]) button.addEventListener(name, () => ((held = null), wake()));
    button.addEventListener("keydown", press);
    if (part !== "area") button.addEventListener("focus", () => select(index));
    return button;
  };
  group.replaceChildren(
    ...start.map((_, i) => grip("", i, "plane")),
    grip("Goal of the ownship; arrows move it", 0, "goal"),
    grip("Course and speed of the chosen aircraft", -1, "tip"),
    ...areas.map((_, i) => grip(`Area ${i + 1}; arrows move it, with Shift they change its size`, i, "area")),
  );
  get("clear").disabled = !areas.length;
  get("count").textContent = start.length - 1;
  get("fewer").disabled = start.length <= 2;
  get("more").disabled = start.length > MOST;
  relabel();
}

function moveGrips(state, place) {
  for (const button of get("grips").children) {
    const area = button.dataset.part === "area";
    const index = button.dataset.part === "tip" ? chosen : Number(button.dataset.index), one = (area ? areas : state.planes)[index];
    button.hidden = !one || (!area && state.gone[index]);
    if (button.hidden) continue;
    const [x, y] = { goal: () => place(one.goalX, one.goalY), tip: () => tipOf(one, place), plane: () => place(one.x, one.y), area: () => place(one.x, one.y) }[button.dataset.part]();
    button.style.transform = `translate(${x}px, ${y}px)`;
  }
}

function label(index) { // said when an aircraft is chosen
  const one = now().planes[index], own = now().planes[0], course = Math.round((450 - (one.heading * 180) / Math.PI) % 360);
  const where = index === 0 ? "" : `, ${metres(Math.hypot(one.x - own.x, one.y - own.y))} away`;
  return `${index === 0 ? "Ownship" : `Intruder ${index}`}${where}, course ${course}°, ${Math.round(one.speed * type.limits.speed_max)} m/s`;
}

function select(index) {
  if (index < 0) return;
  if (chosen !== index) map = null;
  chosen = index;
  relabel();
  wake();
}

function relabel() {
  for (const button of get("grips").children) {
    if (button.dataset.part === "plane") button.setAttribute("aria-label", label(Number(button.dataset.index)));
  }
}

function take(event) {
  const { index, part } = event.currentTarget.dataset;
  if (part !== "area") select(Number(index));
  held = { part, index: part === "tip" ? chosen : Number(index) };
  event.currentTarget.setPointerCapture(event.pointerId);
  event.preventDefault();
  event.currentTarget.focus({ preventScroll: true });
}

function pointed(event) { // at which place of the map
  const { scale, width, height } = view(), box = sky.box.getBoundingClientRect();
  return [(event.clientX - box.left - width / 2) / scale, (height / 2 - (event.clientY - box.top)) / scale];
}

function drag(event) {
  if (!held) return;
  const { scale } = view(), [x, y] = pointed(event);
  edit(() => {
    if (held.part === "size") return void (areas[held.index].radius = Math.max(SMALLEST, Math.hypot(x - areas[held.index].x, y - areas[held.index].y)));
    if (held.part === "area") return void Object.assign(areas[held.index], { x, y });
    const one = start[held.index];
    if (held.part === "goal") [one.goalX, one.goalY] = [x, y];
    else if (held.part === "plane") [one.x, one.y] = [x, y];
    else {
      one.heading = Math.atan2(y - one.y, x - one.x);
      one.speed = (Math.hypot(x - one.x, y - one.y) * scale - 34) / 34;
    }
    limited(one, held.index);
  });
}

function press(event) {
  const index = Number(event.currentTarget.dataset.index), { part } = event.currentTarget.dataset;
  const [x, y] = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key] ?? [0, 0];
  if (part === "area" && (x || y || event.key === "Delete")) changeArea(index, x, y, event);
  else if (event.key === "Delete" && part === "plane" && index > 0 && start.length > 2) remove(index);
  else if (x || y) {
    edit(() => {
      const one = start[index];
      if (part === "goal") (one.goalX += 0.25 * x), (one.goalY += 0.25 * y);
      else if (event.shiftKey) (one.heading -= (x * Math.PI) / 36), (one.speed += 0.05 * y);
      else (one.x += 0.25 * x), (one.y += 0.25 * y);
      limited(one, index);
    });
    select(index);
  } else return;
  event.preventDefault();
}

function changeArea(index, x, y, { key, shiftKey }) {
  const one = areas[index];
  edit(() => {
    if (key === "Delete") areas.splice(index, 1);
    else if (shiftKey) areas[index] = resized(one, Math.max(SMALLEST, one.radius + 0.25 * (x + y)));
    else (one.x += 0.25 * x), (one.y += 0.25 * y);
  });
  if (key !== "Delete") return;
  grips();
  get("disc").focus();
}

// A disc is drawn from its middle to its edge, where no aircraft is.
function drawDisc(event) {
  const [x, y] = pointed(event);
  held = { part: "size", index: areas.length };
  edit(() => areas.push({ x, y, radius: SMALLEST }));
  sky.box.setPointerCapture(event.pointerId);
  event.preventDefault();
}

// A polygon is drawn corner by corner; one at the first closes it.
function drawCorner(event) {
  const { scale } = view(), place = pointed(event), away = ([x, y]) => scale * Math.hypot(place[0] - x, place[1] - y);
  event.preventDefault();
  if (corners.length > 2 && away(corners[0]) <= CLOSING) return closePolygon();
  if (!corners.length || away(corners.at(-1)) > APART) corners.push(place);
  pointer = null;
  wake();
}

function closePolygon() {
  if (corners.length < 3) return;
  edit(() => areas.push(polygonOf(corners, SMALLEST)));
  dropPolygon();
  grips();
}

function dropPolygon() {
  corners = [];
  pointer = null;
  wake();
}

function drawAs(shape) { // by the pointer, or no longer where it is drawn already
  drawing = drawing === shape ? null : shape;
  for (const name of ["disc", "polygon"]) {
    get(name).setAttribute("aria-pressed", drawing === name);
    sky.box.classList.toggle(name, drawing === name);
  }
  dropPolygon();
}

function remove(index) {
  edit(() => start.splice(index, 1));
  chosen = -1;
  shown = null;
  grips();
  document.querySelector(`.grip[data-part=plane][data-index="${Math.min(index, start.length - 1)}"]`).focus();
}

// ---- the loop ----

function frame(moment) {
  const begun = performance.now();
  if (changed && (playing || !line || line.done || !shown)) {
    line = begin(start);
    if (shown?.frames[0].planes.length !== start.length) shown = null;
    time = 0;
    changed = false;
  }
  const elapsed = clip(moment - last, 0, 100);
  last = moment;
  if (playing && !held) time += ((elapsed / 1000) * Number(document.querySelector("[name=pace]:checked").value)) / dt;
  while (!line.done && (line.frames.length < time + 2 || performance.now() < begun + BUDGET.future)) extend(line);
  if (line.done || time > 0 || !shown) shown = line;
  if (line.done && time >= line.frames.length - 1) {
    time = line.frames.length - 1;
    play(false);
  }
  const searching = lookElsewhere(begun + BUDGET.search);
  const unfinished = colourMap(begun + BUDGET.map);
  tell(draw());
  return playing || changed || !line.done || searching || unfinished;
}

// Where the policy will lose the separation: tries other manoeuvres, and returns whether there are more to try.
function lookElsewhere(until) {
  if (changed || !line.done || everyone() || areas.length || line.least.distance >= 1) {
    search = null;
    return false;
  }
  if (search?.planes !== line.frames[0].planes) search = beginSearch(line.frames[0].planes, aircraft);
  if (!search.done) searchOn(search, until, dt, aircraft, STEPS);
  return !search.done;
}

let asked = 0;
function wake() {
  asked ||= requestAnimationFrame((moment) => {
    asked = 0;
    if (frame(moment)) wake();
  });
}

function play(on) {
  if (on && line?.done && time >= line.frames.length - 1) time = 0;
  playing = on;
  get("play").setAttribute("aria-label", on ? "Pause" : "Play");
  get("play").querySelector("path").setAttribute("d", ICONS[on ? "pause" : "play"]);
  last = performance.now();
  wake();
}

function paint() { // colours of the style sheet, light or dark
  const style = getComputedStyle(document.documentElement);
  for (const name of ["sky", "grid", "ink", "soft", "own", "other", "goal", "lost", "left", "right", "line", "area"]) colours[name] = style.getPropertyValue(`--${name}`).trim();
  map = null;
  wake();
}

get("aircraft").append(...Object.entries(WEIGHTS.aircraft).map(([name, { label: text }]) => new Option(text, name)));
get("aircraft").addEventListener("change", (event) => edit(() => {
  choose(event.target.value);
  start.forEach(limited);
}));
get("scene").addEventListener("change", (event) => {
  get("count").textContent = { sides: 5, random: 4 }[event.target.value] ?? 1;
  newScene();
  play(true);
});
get("again").addEventListener("click", () => {
  newScene();
  play(true);
});
get("more").addEventListener("click", () => {
  edit(() => start.push(drawn()));
  shown = null;
  grips();
});
get("fewer").addEventListener("click", () => {
  edit(() => start.pop());
  shown = null;
  grips();
});
for (const input of document.querySelectorAll("[name=decides]")) {
  input.addEventListener("change", () => edit(() => {
    start.forEach(limited);
    shown = null;
  }));
}
for (const id of ["plan", "map"]) get(id).addEventListener("change", () => {
  get("legend").hidden = !get("map").checked;
  wake();
});
get("play").addEventListener("click", () => play(!playing));
seek.addEventListener("input", () => {
  play(false);
  time = Number(seek.value);
});
document.addEventListener("keydown", (event) => {
  if (corners.length && (event.key === "Enter" || event.key === "Escape")) {
    event.key === "Enter" ? closePolygon() : dropPolygon();
    event.preventDefault();
  }
  if (event.key === " " && !event.target.closest("#play, #side, summary")) {
    play(!playing);
    event.preventDefault();
  }
});
sky.box.addEventListener("pointerdown", (event) => {
  if (event.target.closest(".grip")) return;
  if (drawing) return drawing === "disc" ? drawDisc(event) : drawCorner(event);
  chosen = -1;
  wake();
});
sky.box.addEventListener("pointermove", (event) => {
  if (held?.part === "size") return drag(event);
  if (!corners.length || event.pointerType === "touch") return;
  pointer = pointed(event);
  wake();
});
for (const name of ["pointerup", "pointercancel"]) sky.box.addEventListener(name, () => {
  if (held?.part !== "size") return;
  held = null;
  grips();
  wake();
});
for (const shape of ["disc", "polygon"]) get(shape).addEventListener("click", () => drawAs(shape));
get("clear").addEventListener("click", () => {
  edit(() => areas.splice(0));
  grips();
});
new ResizeObserver(wake).observe(sky.box);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", paint);

get("size").textContent = network.size.toLocaleString("en").replaceAll(",", "\u202f");
get("tried").textContent = CANDIDATES.length;
get("digest").textContent = WEIGHTS.sha256.slice(0, 8);
get("trained").textContent = `trained with up to ${WEIGHTS.most} intruders; of more (areas count as such) it looks at the ${WEIGHTS.most} most critical`;
choose("paper");
newScene();
paint();
if (!matchMedia("(prefers-reduced-motion: reduce)").matches) play(true);
document.documentElement.dataset.ready = "";
