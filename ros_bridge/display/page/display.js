// The traffic display: draws the pictures that the server sends (docs/reference/display.md). Texts go in as text, never as markup.
"use strict";

const VERSION = 2; // of pictures
const get = (id) => document.getElementById(id);
const { arcs, bands, bug, circle, clip, compass, fences, fitted, line, mark, onRing, plane, round, stroke, tape, text, tint, whole } = airmap;
const AHEAD = 60; // s of the lines ahead of aircraft
const BESIDE = 172, STRIP = 104; // px: of the tapes of altitude and vertical speed, and of the profile
const PAUSES = [10, 20, 30, 60, 120, 300, 600, 1200]; // s between the times below a profile
const OLD = 2; // s after which a picture that is not followed by another is said to be old
const NAMES = ["none", "preventive", "corrective", "warning"];
const UNITS = {
  aviation: { ranges: [1, 2, 5, 10, 20, 40], metres: 1852, far: "NM", speed: 1 / 0.514444, fast: "kt", high: 1 / 30.48, height: 100 / 30.48, tall: "ft", climb: 196.85, climbs: "ft/min", round: 10, step: 10, span: 80 },
  metric: { ranges: [2, 5, 10, 20, 40, 80], metres: 1000, far: "km", speed: 1, fast: "m/s", high: 0.01, height: 1, tall: "m", climb: 1, climbs: "m/s", round: 0.1, step: 5, span: 40 },
};

const sky = { canvas: document.querySelector("#map canvas"), box: get("map") };
const bar = { canvas: document.querySelector("#bar canvas"), box: get("bar") };
const state = { picture: null, arrived: 0, hello: null, trackUp: true, range: 2, ranged: false, units: "aviation", sound: null, old: false, levels: new Map(), colours: {}, wish: null, asked: false };
const replay = { at: 0, playing: false, waiting: false, length: 0, last: 0 };
let socket = null, wait = 1000, scheduled = false;

// ---- words ----

const units = () => UNITS[state.units];
const distance = (metres) => metres < 1000 ? `${Math.round(metres)} m` : `${(metres / units().metres).toFixed(metres < 10 * units().metres ? 1 : 0)} ${units().far}`;
const degrees = (value) => `${String(Math.round(value) % 360).padStart(3, "0")}°`;
const speed = (value) => `${Math.round(value * units().speed)} ${units().fast}`;
function seconds(value) {
  const count = Math.round(value);
  return count < 100 ? `${count} s` : `${Math.floor(count / 60)} min ${String(count % 60).padStart(2, "0")} s`;
}
const above = (metres) => (metres === null ? "?" : `${metres < 0 ? "−" : "+"}${String(Math.round(Math.abs(metres) * units().high)).padStart(2, "0")}`);
const reported = (metres) => (metres === null ? "?" : String(Math.round(metres * units().high)).padStart(3, "0"));
const climbing = (rate) => (rate === null ? "" : rate * UNITS.aviation.climb > 400 ? "↑" : rate * UNITS.aviation.climb < -400 ? "↓" : "");

// Directions and speeds of own, plan, bands and advice are in one frame, which has a name.
const heightOf = (metres) => `${whole(metres * units().height)} ${units().tall}`;
const rateOf = (climb) => `${+(units().round * Math.round((Math.abs(climb) * units().climb) / units().round)).toFixed(1)} ${units().climbs}`;

// A climb, a descent or level flight, and the altitude at which it ends or which is held.
function riseOf({ climb, altitude }) {
  if (climb === undefined) return "";
  const to = altitude === null ? "" : ` ${heightOf(altitude)}`;
  if (climb === 0) return altitude === null ? ", level off" : `, stay at${to}`;
  return `, ${climb > 0 ? "climb" : "descend"}${to && ` to${to}`} with ${rateOf(climb)}`;
}

const FRAMES = { air: { direction: "heading", short: "HDG", speed: "airspeed" }, ground: { direction: "track", short: "TRK", speed: "ground speed" } };

// A change of direction, speed and climb; `before` is the speed until then.
function manoeuvre(change, before, frame) {
  const { turn, track_deg: track, speed: wanted } = change;
  const { direction } = FRAMES[frame], course = turn === "hold" ? `hold ${direction} ${degrees(track)}` : `turn ${turn} to ${direction} ${degrees(track)}`;
  const faster = wanted - before;
  const paced = Math.abs(faster) > 1.5 ? `${course}, ${faster > 0 ? "faster" : "slower"}: ${speed(wanted)}` : course;
  return paced + riseOf(change);
}

const KINDS = { plan: "Plan", backup: "BACKUP", advised: "Advice, not flown", free: "Free", recovery: "No way is free. Best" };

function order(advice, { own, frame }) {
  return KINDS[advice.do] && `${KINDS[advice.do]}: ${manoeuvre(advice, own.air.speed, frame)}`;
}

// What an aircraft is called: its callsign where it has one.
const called = ({ traffic }, { id }) => traffic.find((one) => one.id === id)?.callsign || id;

// What an alert says is lost.
const lost = (alert) => (alert.of === "area" ? "the clearance is lost" : "separation is lost");

// The advisory: what to do, and why.
function words(picture) {
  const { advice, own, alerts, monitor, frame } = picture, level = alerts.reduce((most, one) => Math.max(most, one.level), 0);
  const reasons = [], worst = alerts[0], next = advice.then;
  if (next) reasons.push(`In ${seconds(next.in)}: ${manoeuvre(next, advice.speed, frame)}`);
  if (worst) reasons.push(`${NAMES[worst.level]} alert: ${called(picture, worst)}${worst.loss === null ? "" : `, ${lost(worst)} in ${seconds(worst.loss)} on the present course`}`);
  reasons.push(...(monitor?.reasons ?? []));
  if (advice.do === "recovery") reasons.push(`${advice.after === null ? "it does not open within the look-ahead" : `it opens after ${seconds(advice.after)}`}; ${distance(advice.shortfall)} less than required until then`);
  if (picture.unresolved && !picture.plan) reasons.push("No safe plan is known; the best one is drawn dotted");
  const heading = worst && worst.of === "area" ? "Area ahead" : "Traffic";
  const nothing = !own ? "The ownship is not known" : monitor && monitor.state === "silent" ? "Monitor silent" : monitor && monitor.fly === "nothing" ? "Own route" : level > 0 ? heading : "No advisory";
  return { level: advice.do === "backup" || advice.do === "recovery" ? 3 : level, kind: advice.do, first: (own && order(advice, picture)) || nothing, why: reasons.join(". ") };
}

// ---- lists; only what changes is touched ----

function fill(list, rows, write) {
  while (list.children.length > rows.length) list.lastChild.remove();
  while (list.children.length < rows.length) list.append(document.createElement(list.tagName === "TBODY" ? "tr" : "li"));
  rows.forEach((row, n) => write(list.children[n], row));
}

function put(element, value) {
  if (element.textContent !== value) element.textContent = value;
}

function part(parent, tag, n) {
  while (parent.children.length <= n) parent.append(document.createElement(tag));
  return parent.children[n];
}

function tell(picture) {
  document.documentElement.toggleAttribute("data-profile", Boolean(picture.plan?.profile)); // needs room
  const { level, kind, first, why } = words(picture), { bands: closed } = picture;
  put(get("order"), first);
  put(get("why"), why);
  get("advice").dataset.level = level;
  get("advice").dataset.kind = kind;
  const none = closed?.track_region.some((region) => region > 0) ? `none on the present course; other ${FRAMES[picture.frame].direction}s are closed` : "none";
  fill(get("alerts"), picture.alerts.length ? picture.alerts : [null], (item, alert) => {
    item.dataset.level = alert ? alert.level : 0;
    put(item, alert ? `${NAMES[alert.level]}: ${called(picture, alert)}${alert.loss === null ? "" : `, ${lost(alert)} in ${seconds(alert.loss)}`}` : none);
  });
  put(get("plan"), planned(picture));
  inputs(picture);
  if (get("table").closest("details").open) table(picture);
  hear(picture);
}

// The inputs; where the picture itself is old, nothing is known of them any more.
function inputs({ health }) {
  const since = state.old ? (performance.now() - state.arrived) / 1000 : 0;
  fill(get("health"), health, (item, one) => {
    const level = state.old ? 3 : one.level, age = one.age + since;
    item.dataset.level = level;
    put(part(item, "b", 0), ["✓", "!", "✗", "…"][level]);
    put(part(item, "span", 1), one.name);
    put(part(item, "time", 2), one.age === null || age > 600 ? "" : `${age.toFixed(age < 10 ? 1 : 0)} s`);
    put(part(item, "small", 3), one.text);
  });
}

function planned({ plan, monitor, own }) {
  const lines = [];
  if (plan) {
    const left = plan.points.filter((point) => point.in > 0);
    lines.push(`Revision ${plan.revision}, waypoints to go: ${left.length}${left.length ? `, the next in ${seconds(left[0].in)}` : ""}.`);
  } else lines.push("None.");
  if (monitor) {
    lines.push(`Monitor: ${monitor.state}.`);
    const off = monitor.altitude_error ?? null, high = off === null ? "" : `, ${heightOf(Math.abs(off))} ${off < 0 ? "below" : "above"} it`;
    if (monitor.measured) lines.push(`${distance(Math.abs(monitor.cross_track))} ${monitor.cross_track < 0 ? "right" : "left"} of it, ${Math.abs(monitor.time_error).toFixed(1)} s ${monitor.time_error < 0 ? "early" : "late"}${high}.`);
    if (monitor.separation !== null) lines.push(`It keeps ${distance(monitor.separation)}.`);
    for (const remark of monitor.remarks) lines.push(`Note: ${remark}.`);
  }
  const climbs = own && own.climb !== null ? `, ${own.climb < 0 ? "−" : ""}${rateOf(own.climb)}` : "";
  if (own && own.altitude !== null) lines.push(`Own altitude ${heightOf(own.altitude)} (${own.reference})${climbs}.`);
  return lines.join(" ");
}

function table({ traffic, own }) {
  const rows = traffic.map((one) => ({ one, apart: own ? Math.hypot(one.x - own.x, one.y - own.y) : null })).sort((a, b) => a.apart - b.apart);
  fill(get("table"), rows, (row, { one, apart }) => {
    const bearing = own ? degrees((Math.atan2(one.x - own.x, one.y - own.y) * 180) / Math.PI + 360) : "";
    const high = one.relative_altitude === null ? "?" : heightOf(one.relative_altitude);
    const rate = one.climb === null ? "?" : `${whole(one.climb * units().climb)} ${units().climbs}`;
    const cells = [one.callsign || one.id, apart === null ? "" : `${distance(apart)} ${bearing}`, `${high}, ${rate}`, one.fault || (one.state === "fresh" ? one.correction : `${one.state}, ${seconds(one.age)}`)];
    cells.forEach((cell, n) => put(part(row, "td", n), cell));
  });
}

function hear({ alerts }) { // a tone where a level is raised to corrective or more
  let raised = 0;
  const levels = new Map(alerts.map((one) => [`${one.of} ${one.id}`, one.level]));
  for (const [id, level] of levels) if (level > (state.levels.get(id) ?? 0)) raised = Math.max(raised, level);
  state.levels = levels;
  if (!state.sound || raised < 2) return;
  const now = state.sound.currentTime;
  for (let n = 0; n < raised; n++) {
    const tone = state.sound.createOscillator(), loud = state.sound.createGain();
    tone.frequency.value = raised === 3 ? 880 : 620;
    loud.gain.value = 0.15;
    tone.connect(loud).connect(state.sound.destination);
    tone.start(now + 0.22 * n);
    tone.stop(now + 0.22 * n + 0.14);
  }
}

// ---- the map ----

// Whether the ownship's climb is shown: where it may be free or not, or is planned.
const solid = ({ own, bands: shown, plan }) => own !== null && own.altitude !== null && own.climb !== null && Boolean(shown?.vertical_speed || plan?.profile);

function view(picture, width, height) {
  const top = get("advice").offsetHeight, beside = get("controls").offsetHeight > get("controls").offsetWidth, { own, traffic } = picture;
  const free = height - top - (beside ? 4 : get("controls").offsetHeight + 14), buttons = beside ? get("controls").offsetWidth + 14 : 0;
  const strip = solid(picture) && picture.plan?.profile && free > 400 ? STRIP : 0, low = height - top - free + strip; // of the buttons and the profile
  const along = (free - strip) / 2 - 40, across = (tapes) => (width - tapes - buttons) / 2 - 34; // bands stand outside, and the direction above them
  const narrow = width < 620 || beside, single = narrow ? 62 : 0; // of the tape of speeds
  const column = solid(picture) && across(single + BESIDE) >= 0.8 * along ? BESIDE : 0, right = buttons + column;
  const stacked = solid(picture) && !column, left = stacked ? 84 : single; // else the tapes stand below each other
  const radius = Math.min(across(left + column), along);
  const centre = [left + (width - left - right) / 2, top + 6 + (height - top - low) / 2];
  const metres = units().ranges[state.range] * units().metres, scale = radius / metres;
  const here = own ?? { x: 0, y: 0, vx: 0, vy: 1, track_deg: 0 };
  const onMap = (Math.atan2(here.vx, here.vy) * 180) / Math.PI, up = state.trackUp && own ? own.track_deg : 0;
  const turn = ((up - (own ? own.track_deg - onMap : 0)) * Math.PI) / 180, cosine = Math.cos(turn), sine = Math.sin(turn);
  const place = (x, y) => {
    const dx = (x - here.x) * scale, dy = (y - here.y) * scale;
    return [centre[0] + dx * cosine - dy * sine, centre[1] - dx * sine - dy * cosine];
  };
  return { centre, radius, scale, up, turn, place, width: width - right, height, top, low, strip, column, stacked, traffic };
}

// Where an aircraft will be after some seconds: on in its turn as long as that is expected, then straight.
function after({ x, y, vx, vy, turn_deg: turns, turn_s: lasts }, time) {
  const turning = clip(lasts, 0, time), half = (turns * turning * Math.PI) / 360, chord = half ? Math.sin(half) / half : 1;
  const turned = (angle) => [vx * Math.cos(angle) - vy * Math.sin(angle), vx * Math.sin(angle) + vy * Math.cos(angle)];
  const [cx, cy] = turned(half), [sx, sy] = turned(2 * half);
  return [x + turning * chord * cx + (time - turning) * sx, y + turning * chord * cy + (time - turning) * sy];
}

const ahead = (one) => Array.from({ length: AHEAD / 5 + 1 }, (_, n) => after(one, 5 * n));

function draw() {
  scheduled = false;
  const { picture, colours } = state;
  const { pen, width, height } = fitted(sky);
  if (!picture || width < 60) return;
  const at = view(picture, width, height), { centre: [cx, cy], radius, scale, place, up } = at, { own } = picture;
  pen.lineCap = pen.lineJoin = "round";
  const through = (points) => line(pen, points.map(([x, y]) => place(x, y)));
  at.labels = [];
  drawAreas(pen, picture.areas, at);
  if (picture.route.length) (through(picture.route), stroke(pen, colours.route, 2, [2, 7]));
  if (picture.goal) {
    const [x, y, size] = picture.goal;
    circle(pen, ...place(x, y), size * scale);
    stroke(pen, colours.goal, 2);
  }
  compass(pen, cx, cy, radius, up, colours);
  circle(pen, cx, cy, radius / 2);
  stroke(pen, colours.line, 1, [2, 5]);
  drawRanges(pen, at);
  if (picture.bands) {
    bands(pen, cx, cy, radius + 3, 22, up, picture.bands.track_deg, picture.bands.track_region, colours);
    fences(pen, cx, cy, radius + 28, up, picture.bands.track_deg, picture.bands.track_area, colours);
    if (picture.bands.recovery) bug(pen, cx, cy, radius + 3, up, picture.bands.recovery.track_deg, colours.recovery, colours.paper, true);
  }
  if (picture.advice.track_deg !== undefined && picture.advice.track_deg !== null) bug(pen, cx, cy, radius + 3, up, picture.advice.track_deg, picture.advice.do === "backup" ? colours.backup : colours.plan, colours.paper);
  if (picture.unresolved) drawUnresolved(pen, picture.unresolved, at);
  if (picture.plan) drawPlan(pen, picture.plan, picture.time, colours.plan, [], at);
  if (picture.backup) drawPlan(pen, picture.backup, picture.time, colours.backup, [10, 5], at);
  if (own) {
    if (picture.separation) (circle(pen, cx, cy, picture.separation * scale), stroke(pen, colours.own, 1.4, [5, 5]));
    if (picture.wind) (line(pen, [onRing(cx, cy, radius, ((own.air.track_deg - up) * Math.PI) / 180), [cx, cy]]), stroke(pen, tint(colours.own, 0.5), 1.2, [2, 6]));
    through(ahead(own));
    stroke(pen, colours.own, 2);
  }
  drawTraffic(pen, picture, at);
  if (own) {
    plane(pen, cx, cy, Math.PI / 2 - ((own.track_deg - up) * Math.PI) / 180, 1.35, colours.own, colours.paper);
    if (own.state !== "fresh") text(pen, `ownship ${own.state} ${seconds(own.age)}`, cx, cy + 34, colours.bad, colours.paper);
    drawTapes(pen, picture, at);
    if (at.strip) drawProfile(pen, picture, at);
  }
  drawWind(pen, picture, at);
  text(pen, state.trackUp && own ? `TRK ${degrees(up)}` : "N", cx, at.top + 16, colours.soft, colours.paper, { size: 12 });
  writeLabels(pen, at);
  document.dispatchEvent(new CustomEvent("drawn", { detail: picture }));
}

// Speeds on the left; altitudes and vertical speeds on the right, or below them where there is no room.
function drawTapes(pen, picture, at) {
  const { own, advice, frame } = picture, { colours } = state, { column, stacked } = at, { tall, climb, climbs, fast } = units();
  const row = picture.bands ?? { speed: [], speed_region: [], speed_area: [] };
  const free = at.height - at.top - at.low - 14, high = stacked ? free / 3 - 36 : clip(free - 26, 90, 260);
  const box = (n, left, width) => ({ left, top: at.top + 14 + (stacked ? (n * free) / 3 : 0), width, height: high });
  const wanted = (value, scale) => (value === undefined || value === null ? null : value * scale);
  const under = ({ left, top }, lines) => lines.forEach((words, n) => text(pen, words, left + 2, top + high + 15 * (n + 1), colours.soft, colours.paper, { size: 12, align: "left" }));

  const now = own.air.speed * units().speed, first = box(0, 6, stacked ? 76 : at.width < 620 ? 58 : 66);
  tape(pen, first, { value: now, span: units().span, step: units().step, words: String(Math.round(now)), targets: row.speed.map((one) => one * units().speed), regions: row.speed_region, areas: row.speed_area, wanted: wanted(advice.speed, units().speed) }, colours);
  under(first, frame === "air" ? [`${fast} air`, `GS ${Math.round(own.speed * units().speed)}`] : [`${fast} ground`]);
  if (!column && !stacked) return;

  const kinds = [["altitude", own.altitude, units().height, 600, 0.5], ["vertical_speed", own.climb, climb, 12, 1.2]];
  kinds.forEach(([name, value, scale, usual, share], n) => {
    const targets = row[name] ?? [], span = (targets.length ? share * (targets.at(-1) - targets[0]) : usual) * scale; // a share of what can be reached
    const there = column ? box(0, at.width + 4 + 84 * n, 78) : box(n + 1, 6, 76);
    const target = name === "altitude" ? advice.altitude : advice.climb;
    const words = name === "altitude" || scale > 10 ? whole(value * scale) : (value * scale).toFixed(1).replace("-", "−");
    tape(pen, there, { value: value * scale, span, step: round(span / 4), words, targets: targets.map((one) => one * scale), regions: row[`${name}_region`] ?? [], areas: row[`${name}_area`] ?? [], wanted: wanted(target, scale), signed: true }, colours);
    under(there, [name === "altitude" ? `${tall} ${own.reference}` : climbs]);
  });
}

// The plan's altitudes over time, from now on, and traffic in the times in which it is near the plan over the ground.
function drawProfile(pen, picture, at) {
  const { plan: { profile }, own, time: now } = picture, { colours } = state;
  const end = Math.min(profile.at(-1)[0], Math.max(levelFrom(profile) + 60, now + 180));
  if (end <= now) return;
  const lines = metAlong(picture, end);
  const rest = [[now, altitudeAt(profile, now)], ...profile.filter(([when]) => when > now && when < end), [end, altitudeAt(profile, end)]];
  const heights = [own.altitude, ...rest.map(([, altitude]) => altitude)], spread = Math.max(...heights) - Math.min(...heights);
  const near = lines.flatMap(({ run }) => run.map(([, altitude]) => altitude)).filter((one) => one !== null && heights.some((other) => Math.abs(one - other) < Math.max(spread, 300)));
  const [lowest, highest] = [Math.min(...heights, ...near), Math.max(...heights, ...near)], pad = Math.max(0.15 * (highest - lowest), 30);
  const box = { left: 60, top: at.height - at.low + 8, width: at.width + at.column - 60 - 14, height: at.strip - 30 };
  const x = (when) => box.left + ((when - now) / (end - now)) * box.width;
  const y = (altitude) => box.top + box.height * (1 - (altitude - lowest + pad) / (highest - lowest + 2 * pad));

  pen.beginPath();
  pen.rect(box.left, box.top, box.width, box.height);
  pen.fillStyle = colours.paper;
  pen.fill();
  stroke(pen, colours.line, 1);
  const scale = units().height, step = round(((highest - lowest + 2 * pad) * scale) / 2);
  for (let one = Math.ceil(((lowest - pad) * scale) / step) * step; one <= (highest + pad) * scale; one += step) {
    line(pen, [[box.left, y(one / scale)], [box.left + box.width, y(one / scale)]]);
    stroke(pen, colours.line, 1, [1, 4]);
    text(pen, whole(one), box.left - 14, y(one / scale) + 4, colours.soft, colours.paper, { size: 12, weight: 400, align: "right" });
  }
  for (let one = 0, every = PAUSES.find((some) => some * box.width > 90 * (end - now)) ?? PAUSES.at(-1); x(now + one) < box.left + box.width - 30; one += every) text(pen, one ? seconds(one) : units().tall, one ? x(now + one) : box.left - 14, box.top + box.height + 15, colours.soft, colours.paper, { size: 12, weight: 400, align: one ? "center" : "right" });

  pen.save();
  pen.beginPath();
  pen.rect(box.left, box.top, box.width, box.height);
  pen.clip();
  for (const { one, run } of lines) {
    const colour = one.level > 0 ? colours[NAMES[one.level]] : colours.traffic, unknown = one.relative_altitude === null;
    if (unknown) { // it may be at every altitude
      pen.fillStyle = tint(colour, 0.2);
      pen.fillRect(x(run[0][0]), box.top, Math.max(x(run.at(-1)[0]) - x(run[0][0]), 4), box.height);
    } else {
      line(pen, run.map(([when, altitude]) => [x(when), y(altitude)]));
      stroke(pen, colour, one.level > 0 ? 6 : 4);
    }
    const [when, altitude] = run[Math.floor(run.length / 2)], name = one.callsign || one.id;
    const foot = unknown ? box.top + 14 : clip(y(altitude) - 6, box.top + 12, box.top + box.height - 4);
    text(pen, (name.length > 14 ? `${name.slice(0, 13)}…` : name) + (unknown ? " ?" : ""), clip(x(when), box.left + 30, box.left + box.width - 30), foot, colour, colours.paper, { size: 12 });
  }
  line(pen, rest.map(([when, altitude]) => [x(when), y(altitude)]));
  stroke(pen, colours.plan, 3);
  for (const [when, altitude] of rest.slice(1, -1)) {
    circle(pen, x(when), y(altitude), 3);
    pen.fillStyle = colours.plan;
    pen.fill();
  }
  if (own.climb !== null) (line(pen, [[x(now), y(own.altitude)], [x(now + AHEAD), y(own.altitude + AHEAD * own.climb)]]), stroke(pen, colours.own, 1.6, [4, 4]));
  pen.restore();
  plane(pen, box.left, y(own.altitude), Math.atan2(y(own.altitude) - y(own.altitude + 10 * (own.climb ?? 0)), x(now + 10) - x(now)), 0.9, colours.own, colours.paper);
}

// From when on a profile stays level.
function levelFrom(profile) {
  const last = profile.findLastIndex(([, altitude]) => Math.abs(altitude - profile.at(-1)[1]) > 1);
  return profile[Math.min(last + 1, profile.length - 1)][0];
}

// The altitude of a profile at a time.
function altitudeAt(profile, time) {
  const next = clip(profile.findIndex(([when]) => when > time), 1, profile.length - 1), [[from, low], [to, high]] = [profile[next - 1], profile[next]];
  return low + ((high - low) * (time - from)) / (to - from);
}

// Traffic with the times in which it is nearer to the plan over the ground than is kept from it, and its altitudes then; null: unknown.
function metAlong({ plan: { line: path }, traffic, own, separation, time: now }, end) {
  const met = [];
  for (const one of traffic) {
    const kept = one.separation ?? separation, above_ = one.relative_altitude;
    let run = null;
    for (const [x, y, when] of kept ? path : []) {
      if (when < now || when > end) continue;
      const [tx, ty] = after(one, when - now);
      if (Math.hypot(tx - x, ty - y) > kept) run = null;
      else {
        if (!run) met.push({ one, run: (run = []) });
        run.push([when, above_ === null ? null : own.altitude + above_ + (one.climb ?? 0) * (when - now)]);
      }
    }
  }
  return met;
}

function drawAreas(pen, areas, at) {
  const { colours } = state, { place, scale } = at;
  for (const area of areas) {
    const trace = () => {
      if (area.circle) {
        const [x, y] = place(area.circle[0], area.circle[1]);
        pen.arc(x, y, area.circle[2] * scale, 0, 2 * Math.PI);
      } else for (const ring of area.rings) {
        ring.forEach(([x, y], n) => pen[n ? "lineTo" : "moveTo"](...place(x, y)));
        pen.closePath();
      }
    };
    if (area.valid) drawGrown(pen, area, trace, at);
    pen.beginPath();
    trace();
    if (area.keep === "out" && area.valid) (pen.fillStyle = tint(colours.area, 0.16)), pen.fill("evenodd");
    stroke(pen, colours.area, area.valid ? 2 : 1, area.keep === "in" ? [12, 5] : area.valid ? [] : [2, 5]);
    const [x, y, radius] = area.circle ?? area.rings[0][0];
    const heights = [area.floor, area.ceiling].map((one) => (one === null ? "" : `${Math.round(one[0] * units().height)}`));
    const between = heights.some(Boolean) ? ` ${heights[0] || "0"}–${heights[1] || "…"} ${units().tall}` : "";
    at.labels.push({ rank: 9, at: place(x, area.circle && area.keep === "in" ? y + radius : y), lines: [{ words: `${area.keep === "in" ? "stay in " : ""}${area.name}${between}`, colour: colours.area }] });
  }
}

// What else is forbidden since a polygon has grown, or one to stay in has shrunk: a strip along its edges.
function drawGrown(pen, { keep, grown }, trace, { scale, width, height }) {
  if (keep === "out" ? !(grown > 0) : !(grown < 0)) return;
  pen.save();
  pen.beginPath();
  if (keep === "out") pen.rect(0, 0, width, height);
  trace();
  pen.clip("evenodd");
  pen.beginPath();
  trace();
  stroke(pen, tint(state.colours.area, 0.3), 2 * Math.abs(grown) * scale);
  pen.restore();
}

function drawUnresolved(pen, { line: points }, { place }) {
  const { colours } = state, [x, y] = place(...points[Math.floor(points.length / 2)]);
  line(pen, points.map(([px, py]) => place(px, py)));
  stroke(pen, colours.plan, 2, [1, 6]);
  text(pen, "not safe", x + 9, y - 6, colours.plan, colours.paper, { size: 12, align: "left" });
}

function drawPlan(pen, plan, now, colour, dash, { place, centre, radius, labels }) {
  const { colours } = state, coming = plan.line.filter(([, , time]) => time >= now - 4);
  line(pen, plan.line.map(([x, y]) => place(x, y)));
  stroke(pen, tint(colour, 0.35), 2, dash);
  line(pen, coming.map(([x, y]) => place(x, y)));
  stroke(pen, colours.paper, 6);
  stroke(pen, colour, 3, dash);
  for (const point of plan.points) {
    if (point.in <= 0) continue;
    const [x, y] = place(point.x, point.y);
    if (Math.hypot(x - centre[0], y - centre[1]) > radius - 8) continue; // the ring stays readable
    circle(pen, x, y, 4);
    pen.fillStyle = colour;
    pen.fill();
    stroke(pen, colours.paper, 1.5);
    const lines = [{ words: seconds(point.in), colour }];
    if (point.altitude !== null) lines.push({ words: heightOf(point.altitude), colour });
    labels.push({ rank: 8, at: [x, y], lines });
  }
}

function drawTraffic(pen, { traffic, own }, { place, scale, width, height, turn, labels }) {
  const { colours } = state;
  const apart = (one) => (own ? Math.hypot(one.x - own.x, one.y - own.y) : 0);
  const shown = traffic.map((one) => ({ one, at: place(one.x, one.y) })).filter(({ at: [x, y] }) => x > -40 && y > -40 && x < width + 40 && y < height + 40);
  shown.sort((a, b) => b.one.level - a.one.level || apart(a.one) - apart(b.one));
  for (const { one, at: [x, y] } of shown.toReversed()) {
    const colour = one.level > 0 ? colours[NAMES[one.level]] : colours.traffic, late = one.state !== "fresh";
    if (one.accuracy * scale > 10) { // where it may be, by two sigmas, wider than its symbol
      circle(pen, x, y, one.accuracy * scale);
      pen.fillStyle = tint(colour, 0.15);
      pen.fill();
    }
    if (one.separation) (circle(pen, x, y, one.separation * scale), stroke(pen, tint(colour, 0.7), 1.2, [5, 5]));
    line(pen, ahead(one).map(([px, py]) => place(px, py)));
    stroke(pen, tint(colour, late ? 0.45 : 0.9), one.level > 0 ? 2.4 : 1.5, late ? [3, 4] : []);
    const moves = Math.hypot(one.vx, one.vy) > 1 ? Math.atan2(one.vx, one.vy) - turn : null;
    mark(pen, x, y, one.level, 8, colour, colours.paper, { late, proximate: one.proximate, points: moves });
    if (one.state === "stale" || one.state === "faulty") {
      for (const side of [-10, 10]) {
        line(pen, [[x - 10, y - side], [x + 10, y + side]]);
        stroke(pen, colours.bad, 2.5);
      }
    }
  }
  for (const { one, at: where } of shown) {
    const high = own ? above(one.relative_altitude) : reported(one.altitude);
    // A climb that is not known is no level flight.
    const trend = high !== "?" && one.climb === null ? "?" : climbing(one.climb);
    const name = one.callsign || one.id, colour = one.level > 0 ? colours[NAMES[one.level]] : colours.traffic;
    const lines = [{ words: name.length > 14 ? `${name.slice(0, 13)}…` : name, colour }];
    if (one.state !== "fresh") lines.push({ words: one.state === "faulty" ? "faulty" : `${one.state} ${seconds(one.age)}`, colour: colours.bad });
    const below = own && one.relative_altitude < 0 ? 1 : -1; // the altitude stands on its side of the symbol
    labels.push({ rank: 3 - one.level, must: one.level > 0, at: where, side: below, lines: [{ words: high + trend, colour, size: 15, weight: 700 }] });
    labels.push({ rank: 7 - one.level, must: one.level > 0, at: where, lines });
  }
}

const SIDES = [[1, -0.2], [-1, -0.2], [1, 1], [-1, 1], [1, -1], [-1, -1], [0, -1.6], [0, 1.6]]; // where a label stands about its point

// Writes labels, the most important first; one that finds no free place is left out, unless it must be there.
function writeLabels(pen, { labels, centre, radius, up, width, height, top, low }) {
  const { colours } = state, taken = [];
  for (let way = 0; way < 360; way += 30) { // what the ring says stays readable
    const [x, y] = onRing(...centre, radius - 20, ((way - up) * Math.PI) / 180);
    taken.push([x - 10, y - 8, 20, 16]);
  }
  labels.sort((a, b) => a.rank - b.rank);
  for (const { at: [x, y], lines, side, must } of labels) {
    if (x < 0 || y < top || x > width || y > height - low) continue;
    const tall = lines.reduce((sum, { size = 12 }) => sum + size + 2, 0);
    const wide = Math.max(...lines.map(({ words, size = 12, weight = 600 }) => ((pen.font = `${weight} ${size}px ${airmap.FONT}`), pen.measureText(words).width)));
    const boxes = (side ? [[0, 1.2 * side]] : SIDES).map(([dx, dy]) => [x + dx * 13 + (dx - 1) * (wide / 2), y + dy * 14 + (dy < -1 ? -tall : dy > 1 ? 0 : -tall / 2), wide, tall]);
    const inside = ([bx, by, bw, bh]) => bx >= 2 && by >= top && bx + bw <= width - 2 && by + bh <= height - low;
    const clear = ([bx, by, bw, bh]) => !taken.some(([ox, oy, ow, oh]) => bx < ox + ow && ox < bx + bw && by < oy + oh && oy < by + bh);
    const box = boxes.find((one) => inside(one) && clear(one)) ?? (must ? boxes[0] : null);
    if (!box) continue; // the table has it
    taken.push(box);
    let foot = box[1];
    for (const { words, colour, size = 12, weight = 600 } of lines) {
      text(pen, words, box[0] + wide / 2, (foot += size), colour, colours.paper, { size, weight });
      foot += 2;
    }
  }
  state.boxes = taken; // where texts stand, px
}

// The range on both rings.
function drawRanges(pen, { centre: [x, y], radius }) {
  const { colours } = state, far = units().ranges[state.range];
  for (const share of [0.5, 1]) text(pen, `${share * far}${share === 1 ? ` ${units().far}` : ""}`, ...onRing(x, y + 4, share * radius - (share === 1 ? 34 : 0), (-3 * Math.PI) / 4), colours.soft, colours.paper, { size: 12 });
}

function drawWind(pen, { wind, time }, { width, top, turn }) {
  const { colours } = state;
  // A clock that counts from 1970, not from a start.
  const clock = time > 1e9 ? `${new Date(1000 * time).toISOString().slice(11, 19)} UTC` : "";
  text(pen, clock, width - 8, top + 18, colours.soft, colours.paper, { size: 12, align: "right" });
  if (!wind || Math.hypot(...wind) < 0.25) return;
  const [x, y] = [width - 44, top + 50], angle = Math.atan2(wind[0], wind[1]) - turn;
  line(pen, [onRing(x, y, 18, angle + Math.PI), onRing(x, y, 18, angle)]);
  stroke(pen, colours.wind, 2.5);
  line(pen, [onRing(x, y, 10, angle + 0.5), onRing(x, y, 18, angle), onRing(x, y, 10, angle - 0.5)]);
  stroke(pen, colours.wind, 2.5);
  const from = (Math.atan2(-wind[0], -wind[1]) * 180) / Math.PI + 360;
  text(pen, `${degrees(from)} ${speed(Math.hypot(...wind))}`, width - 8, y + 34, colours.wind, colours.paper, { size: 12, align: "right" });
}

function drawBar() {
  if (!state.hello || state.hello.live) return;
  const { pen, width, height } = fitted(bar), marks = state.hello.marks, end = Math.max(replay.length, 0.001);
  marks.forEach(([time, level], n) => {
    if (!level) return;
    const until = marks[n + 1]?.[0] ?? end, x = (time / end) * width;
    pen.fillStyle = state.colours[NAMES[level]];
    pen.fillRect(x, height - 6 - 4 * level, Math.max((until / end) * width - x, 2), 4 * level);
  });
}

// ---- what comes and goes ----

function redraw() {
  if (scheduled) return;
  scheduled = true;
  requestAnimationFrame(draw);
}

// The range of the first picture: a hundred seconds ahead, and eight separations.
function suit({ own, separation }) {
  if (state.ranged || !own) return;
  state.ranged = true;
  const wanted = Math.max(100 * own.speed, 8 * (separation ?? 0)) / units().metres, fits = units().ranges.findIndex((range) => range >= wanted);
  state.range = fits < 0 ? units().ranges.length - 1 : fits;
  show();
}

function receive(message) {
  const document_ = JSON.parse(message);
  if (document_.version !== VERSION) return warn("The server is of another version: load this page again");
  if (document_.type === "hello") return begin(document_);
  state.picture = document_;
  state.arrived = performance.now();
  replay.waiting = false;
  suit(document_);
  tell(document_);
  redraw();
  if (!state.hello.live) moment(document_.at);
  document.documentElement.dataset.ready = "1";
}

function begin(hello) {
  state.hello = hello;
  put(get("source"), `Source: ${hello.source}`);
  get("time").hidden = hello.live;
  if (hello.live) return;
  replay.length = hello.length;
  get("seek").max = hello.length;
  drawBar();
  ask(replay.at);
}

function ask(time) {
  replay.at = clip(time, 0, replay.length);
  if (!socket || socket.readyState !== WebSocket.OPEN) return;
  if (replay.waiting) return void (state.asked = true);
  replay.waiting = true;
  state.asked = false;
  socket.send(JSON.stringify({ time: replay.at }));
}

function moment(shown) {
  get("seek").value = replay.at;
  put(get("clock"), seconds(replay.at));
  get("seek").setAttribute("aria-valuetext", seconds(replay.at));
  if (state.asked && shown !== replay.at) ask(replay.at);
}

function run(now) {
  if (!replay.playing) return;
  const passed = Math.min(now - replay.last, 250) / 1000;
  replay.last = now;
  if (!replay.waiting) ask(replay.at + passed * Number(get("pace").value));
  else replay.at = Math.min(replay.at + passed * Number(get("pace").value), replay.length);
  if (replay.at >= replay.length) play(false);
  requestAnimationFrame(run);
}

function play(on) {
  if (on && replay.at >= replay.length) replay.at = 0;
  replay.playing = on;
  replay.last = performance.now();
  put(get("play"), on ? "Pause" : "Play");
  if (on) requestAnimationFrame(run);
}

// Says that the picture is old, and shows it as such; an empty text: it is not.
function warn(words) {
  get("link").hidden = !words;
  put(get("link"), words);
  state.old = Boolean(words);
  document.documentElement.toggleAttribute("data-old", state.old);
  if (state.picture) inputs(state.picture);
}

function connect() {
  socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/pictures`);
  socket.onopen = () => ((wait = 1000), warn(""));
  socket.onmessage = ({ data }) => receive(data);
  socket.onclose = () => {
    replay.waiting = false;
    warn("No connection to the display's server: what is drawn is old. Trying again …");
    setTimeout(connect, wait);
    wait = Math.min(2 * wait, 10_000);
  };
}

setInterval(() => { // a picture that stands still must not look as if it were new
  if (!state.hello?.live || socket.readyState !== WebSocket.OPEN) return;
  const old = (performance.now() - state.arrived) / 1000;
  if (old > OLD) warn(`This picture is ${Math.round(old)} s old`);
  else if (!get("link").hidden) warn("");
}, 500);

// ---- settings ----

const dusk = matchMedia("(prefers-color-scheme: dark)");

function theme() {
  const night = state.wish === null ? dusk.matches : state.wish;
  document.documentElement.dataset.theme = night ? "night" : "day";
  put(get("theme"), night ? "Day" : "Night");
  const style = getComputedStyle(document.documentElement);
  for (const name of ["paper", "panel", "ink", "soft", "line", "own", "plan", "backup", "route", "area", "goal", "wind", "free", "preventive", "corrective", "warning", "recovery", "traffic", "ok", "bad"]) state.colours[name] = style.getPropertyValue(`--${name}`).trim();
  for (const canvas of document.querySelectorAll(".sign")) {
    const { pen, width, height } = fitted({ canvas, box: canvas });
    const level = Number(canvas.dataset.level ?? 0), colour = state.colours[level ? NAMES[level] : "traffic"];
    mark(pen, (width || 26) / 2, (height || 26) / 2, level, 7, colour, state.colours.panel, { late: "late" in canvas.dataset, proximate: "proximate" in canvas.dataset, points: 0 });
  }
  drawBar();
  redraw();
}

function show() {
  put(get("range"), `${units().ranges[state.range]} ${units().far}`);
  put(get("units"), state.units === "aviation" ? "Metric" : "Aviation");
  put(get("up"), state.trackUp ? "Track up" : "North up");
  get("up").setAttribute("aria-pressed", state.trackUp);
  if (state.picture) tell(state.picture);
  redraw();
}

const actions = {
  up: () => (state.trackUp = !state.trackUp),
  closer: () => (state.range = Math.max(state.range - 1, 0), state.ranged = true),
  farther: () => (state.range = Math.min(state.range + 1, units().ranges.length - 1), state.ranged = true),
  theme: () => ((state.wish = document.documentElement.dataset.theme !== "night"), theme()),
  units: () => (state.units = state.units === "aviation" ? "metric" : "aviation"),
  sound: () => {
    if (state.sound) (state.sound.close(), (state.sound = null));
    else state.sound = new AudioContext();
    get("sound").setAttribute("aria-pressed", Boolean(state.sound));
    put(get("sound"), state.sound ? "Sound on" : "Sound off");
  },
};
const KEYS = { t: "up", "+": "closer", "=": "closer", "-": "farther", d: "theme", u: "units", s: "sound" };

for (const [id, act] of Object.entries(actions)) get(id).addEventListener("click", () => (act(), show()));
document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey || event.target.tagName === "SELECT") return;
  const name = KEYS[event.key.toLowerCase()];
  if (name) (actions[name](), show());
  else if (state.hello && !state.hello.live && event.target.tagName !== "INPUT") {
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (step) (play(false), ask(replay.at + step));
    else if (event.key === " " && event.target.tagName !== "BUTTON" && event.target.tagName !== "SUMMARY") (play(!replay.playing), event.preventDefault());
    else return;
  } else return;
});
get("play").addEventListener("click", () => play(!replay.playing));
get("seek").addEventListener("input", () => (play(false), ask(Number(get("seek").value))));
for (const details of document.querySelectorAll("details")) details.addEventListener("toggle", () => (theme(), show()));
dusk.addEventListener("change", theme);
new ResizeObserver(() => (drawBar(), redraw())).observe(get("map"));

theme();
show();
connect();
