"use strict";
// The page's own script: it draws the points, filters them, and replays a flight. All text goes in as text, never as markup.
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const $ = (id) => document.getElementById(id);
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const numbers = new Int32Array(bytes(data.number).buffer);
  const kinds = bytes(data.kind);
  const columns = {};
  for (const [name, text] of Object.entries(data.columns)) columns[name] = new Float32Array(bytes(text).buffer);
  const texts = {};
  for (const [name, { words, codes }] of Object.entries(data.texts)) {
    const decoded = bytes(codes);
    texts[name] = (row) => words[decoded[row]];
  }
  const rowOf = new Map(Array.from(numbers, (number, row) => [number, row]));
  const km = Array.from(columns.distance_m, (d) => Math.max(d / 1000, 0.05));
  const tracked = Uint8Array.from(numbers, (number) => (data.flights[number] ? 1 : 0));
  const MARKS = [
    { symbol: "circle", size: 4 },
    { symbol: "rect", size: 6, hollow: true },
    { symbol: "triangle", size: 9 },
    { symbol: "diamond", size: 8 },
    { symbol: "path://M-5-4 L-4-5 L0-1 L4-5 L5-4 L1 0 L5 4 L4 5 L0 1 L-4 5 L-5 4 L-1 0Z", size: 8 },
  ];
  const state = { row: -1, flight: null, time: 0, timer: null, visible: [] };
  const charts = {};
  let colour = {};

  // Colours, and light or dark

  const system = matchMedia("(prefers-color-scheme: dark)");
  const paper = matchMedia("print");
  let wish = null, printing = false;

  function readColours() {
    const style = getComputedStyle(document.documentElement);
    const names = ["paper", "ink", "soft", "line", "grid", "accent", "own", "other", "goal", "plan", "witness", "route", "area", ...airmap.REGIONS];
    colour = Object.fromEntries(names.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
    colour.kinds = data.kinds.map((_, i) => style.getPropertyValue(`--kind-${i}`).trim());
  }

  function applyTheme() {
    // Paper is white whatever the screen is, and as wide as the style sheet says.
    const onPaper = printing || paper.matches;
    document.documentElement.toggleAttribute("data-printing", onPaper);
    const dark = !onPaper && (wish ?? (system.matches ? "dark" : "light")) === "dark";
    document.documentElement.dataset.theme = dark ? "dark" : "light";
    $("theme").textContent = dark ? "Light" : "Dark";
    readColours();
    if (charts.polar) drawAll();
  }

  // Points

  const axisStyle = () => ({
    axisLine: { lineStyle: { color: colour.line } },
    axisTick: { lineStyle: { color: colour.line } },
    axisLabel: { color: colour.soft },
    nameTextStyle: { color: colour.soft },
    splitLine: { lineStyle: { color: colour.grid } },
  });

  const tooltip = () => ({
    trigger: "item",
    renderMode: "richText",
    backgroundColor: colour.paper,
    borderColor: colour.line,
    textStyle: { color: colour.ink },
    formatter: (point) => (point.seriesId.startsWith("kind") ? titleOf(point.data[2]) : ""),
  });

  function rings() {
    const low = Math.log10(0.8 * Math.min(...extent(km))), high = Math.log10(1.1 * Math.max(...extent(km)));
    const marks = [];
    for (let power = -2; power < 4; power++)
      for (const digit of [1, 2, 5]) {
        const at = Math.log10(digit) + power;
        if (at >= low && at <= high) marks.push(at);
      }
    return { low, high, marks };
  }

  function extent(values) {
    let low = Infinity, high = -Infinity;
    for (const value of values) { low = Math.min(low, value); high = Math.max(high, value); }
    return [low, high];
  }

  function distanceAxis() {
    const { low, high, marks } = rings();
    const style = axisStyle();
    return {
      ...style,
      type: "value",
      min: low,
      max: high,
      axisTick: { ...style.axisTick, customValues: marks },
      axisLabel: { ...style.axisLabel, customValues: marks, formatter: (v) => `${Number((10 ** v).toPrecision(2))} km` },
      splitLine: { ...style.splitLine, customValues: marks },
      minorTick: { show: false },
    };
  }

  function pointSeries(place, extra) {
    const series = data.kinds.map((name, kind) => {
      const mark = MARKS[kind];
      const fill = colour.kinds[kind];
      return {
        id: `kind${kind}`, name, type: "scatter", symbol: mark.symbol, symbolSize: mark.size, z: 2 + kind, animation: false, progressive: 0,
        itemStyle: mark.hollow ? { color: "transparent", borderColor: fill, borderWidth: 1.2 } : { color: fill },
        emphasis: { disabled: true }, cursor: "pointer", ...extra,
        data: state.visible.filter((row) => kinds[row] === kind).map((row) => [...place(row), row]),
      };
    });
    series.push({
      id: "chosen", type: "scatter", symbol: "circle", symbolSize: 17, z: 20, silent: true, animation: false, ...extra,
      itemStyle: { color: "transparent", borderColor: colour.ink, borderWidth: 2.2 },
      data: state.row < 0 ? [] : [[...place(state.row), state.row]],
    });
    return series;
  }

  const inPolar = (row) => [Math.log10(km[row]), (columns.bearing_deg[row] + 360) % 360];
  const inPlane = (row) => [columns.relative_heading_deg[row], Math.log10(km[row])];

  function drawPoints() {
    const side = (a) => (a % 180 === 0 ? `${a}°` : a < 180 ? `${a}° left` : `${360 - a}° right`);
    const style = axisStyle();
    charts.polar.setOption({
      animation: false,
      tooltip: tooltip(),
      polar: { radius: Math.max(60, Math.min($("polar").clientWidth / 2 - 78, $("polar").clientHeight / 2 - 44)) },
      angleAxis: { ...style, type: "value", min: 0, max: 360, interval: 30, startAngle: 90, clockwise: false, axisLabel: { ...style.axisLabel, formatter: side } },
      radiusAxis: { ...distanceAxis(), axisLabel: { ...distanceAxis().axisLabel, color: colour.ink, textBorderColor: colour.paper, textBorderWidth: 3, fontSize: 11 }, axisAngle: 0, z: 12 },
      series: pointSeries(inPolar, { coordinateSystem: "polar" }),
    }, { notMerge: true });
    charts.plane.setOption({
      animation: false,
      tooltip: tooltip(),
      grid: { left: 62, right: 16, top: 16, bottom: 44 },
      xAxis: { ...style, type: "value", min: -180, max: 180, interval: 60, name: "degrees, counter-clockwise", nameLocation: "middle", nameGap: 26 },
      yAxis: distanceAxis(),
      series: pointSeries(inPlane, {}),
    }, { notMerge: true });
  }

  function markChosen() {
    const of = (place) => ({ series: [{ id: "chosen", data: state.row < 0 ? [] : [[...place(state.row), state.row]] }] });
    charts.polar.setOption(of(inPolar));
    charts.plane.setOption(of(inPlane));
  }

  // Filter and list

  const fixed = (value, digits, unit) => (Number.isFinite(value) ? `${value.toFixed(digits)} ${unit}` : "-");
  // Isolated, so that a name written from right to left leaves what follows alone.
  const nameOf = (row) => (data.names && data.names[row] !== null ? ` "\u2068${data.names[row]}\u2069"` : "");
  const titleOf = (row) =>
    `${numbers[row]}${nameOf(row)} · ${data.kinds[kinds[row]]} · ${fixed(columns.min_separation_m[row], 0, "m")} · ${fixed(columns.duration_s[row], 0, "s")}`;

  function filter() {
    const wanted = new Set([...document.querySelectorAll('input[name="kind"]:checked')].map((box) => Number(box.value)));
    const near = $("near").checked, withTracks = $("tracked").checked;
    state.visible = [];
    for (let row = 0; row < data.count; row++)
      if (wanted.has(kinds[row]) && (!near || columns.min_separation_m[row] < data.near) && (!withTracks || tracked[row]))
        state.visible.push(row);
    drawPoints();
    fillList();
  }

  function fillList() {
    const rows = state.visible.filter((row) => tracked[row]);
    const above = (value) => (Number.isNaN(value) ? Infinity : value);
    const nearest = (a, b) => above(columns.min_separation_m[a]) - above(columns.min_separation_m[b]) || a - b;
    // What nobody could have solved comes last.
    const rank = ["loss of separation", "geofence violation", "time-out", "success", "proven unresolvable"];
    const rankOf = (row) => rank.indexOf(data.kinds[kinds[row]]);
    const orders = {
      failures: (a, b) => rankOf(a) - rankOf(b) || nearest(a, b),
      nearest,
      number: (a, b) => a - b,
      longest: (a, b) => columns.duration_s[b] - columns.duration_s[a] || a - b,
    };
    rows.sort(orders[$("order").value]);
    $("list").replaceChildren(...rows.map((row) => new Option(titleOf(row), numbers[row], false, row === state.row)));
    $("listed").textContent = `${rows.length} with tracks, of ${state.visible.length} shown`;
  }

  function move(by) {
    const list = $("list");
    if (!list.length) return;
    list.selectedIndex = Math.min(list.length - 1, Math.max(0, list.selectedIndex + by));
    choose(Number(list.value));
  }

  function choose(number) {
    const row = rowOf.get(number);
    stop();
    if (row === undefined) {
      note(`Encounter ${number} is not on this page.`);
      return;
    }
    state.row = row;
    state.flight = data.flights[number] ? unpacked(data.flights[number]) : null;
    const flight = state.flight;
    $("chosen").textContent = `Encounter ${titleOf(row)}`;
    $("list").value = String(number);
    $("goto").value = String(number);
    note(
      !flight
        ? `No tracks were stored of this encounter: python -m eval.report DIR --show ${number} adds them.`
        : flight.differs ? "Flown again, this encounter ended otherwise than the table says." : "",
    );
    for (const id of ["play", "time", "speed"]) $(id).disabled = !flight;
    $("time").max = flight ? flight.steps : 1;
    state.time = flight ? flight.closest : 0;
    facts();
    markChosen();
    drawFlight();
    if (location.hash !== `#${number}`) history.replaceState(null, "", `#${number}`);
  }

  function note(text) {
    $("note").textContent = text;
    $("note").hidden = !text;
  }

  const FACTS = [
    ["min_separation_m", "smallest separation", 1, "m"],
    ["time_of_min_separation_s", "at", 1, "s"],
    ["horizontal_miss_m", "nearest horizontally", 1, "m"],
    ["vertical_miss_m", "vertical distance then", 1, "m"],
    ["altitude_deviation_m", "off the first altitude", 1, "m"],
    ["climbs", "climbs and descents", 0, ""],
    ["duration_s", "duration", 1, "s"],
    ["path_excess", "extra track distance", 2, "%", 100],
    ["goal_distance_m", "left to the goal", 0, "m"],
    ["heading_reversals", "heading reversals", 0, ""],
    ["verdict", "verdict"],
    ["verdict_method", "decided by"],
    ["baseline_outcome", "without a resolver"],
    ["baseline_min_separation_m", "its separation", 1, "m"],
    ["policy_outcome", "policy alone"],
    ["policy_min_separation_m", "its separation", 1, "m"],
    ["plan_status", "plan"],
    ["plan_source", "made by"],
    ["plan_min_separation_m", "planned separation", 1, "m"],
    ["replans", "new plans", 0, ""],
    ["backup_s", "on the backup", 0, "s"],
    ["areas", "areas", 0, ""],
    ["min_area_clearance_m", "beyond their clearance", 1, "m"],
    ["area_breach_s", "entered after", 1, "s"],
    ["intruders", "intruders", 0, ""],
    ["distance_m", "distance at the start", 0, "m"],
    ["vertical_distance_m", "intruder above by", 0, "m"],
    ["intruder_climb_m_s", "intruder's climb", 1, "m/s"],
    ["bearing_deg", "bearing, left positive", 1, "°"],
    ["relative_heading_deg", "relative heading", 1, "°"],
    ["own_speed_m_s", "own speed", 1, "m/s"],
    ["intruder_speed_m_s", "intruder's speed", 1, "m/s"],
    ["t_cpa_s", "straight CPA in", 1, "s"],
    ["d_cpa_m", "straight CPA at", 0, "m"],
  ];

  // What outcomes are called elsewhere on the page.
  const OUTCOMES = { reached: "success", violation: "loss of separation", timeout: "time-out", breach: "geofence violation" };

  function facts() {
    const row = state.row;
    const pairs = [];
    for (const [name, label, digits, unit, factor] of FACTS)
      if (columns[name]) pairs.push([label, fixed(columns[name][row] * (factor ?? 1), digits, unit)]);
      else if (texts[name]) {
        const text = texts[name](row);
        pairs.push([label, OUTCOMES[text] ?? text.replaceAll("_", " ")]);
      }
    const witness = state.flight?.witness;
    if (witness) pairs.push(["resolving flight", `${fixed(witness.separation, 0, "m")}, ${fixed(witness.arrival, 0, "s")}`]);
    $("facts").replaceChildren(
      ...pairs.map(([label, value]) => {
        const pair = document.createElement("div");
        pair.append(document.createElement("dt"), document.createElement("dd"));
        pair.firstChild.textContent = label;
        pair.lastChild.textContent = value;
        return pair;
      }),
    );
  }

  // Replay

  function unpacked(stored) {
    const whole = new Int16Array(bytes(stored.packed).buffer);
    let at = 0;
    const next = (count, scale) => Array.from(whole.subarray(at, (at += count)), (value) => value * scale);
    const states = stored.steps + 1;
    const track = (count) => ({ x: next(count, stored.scale), y: next(count, stored.scale) });
    const flight = { ...stored, own: track(states), others: [] };
    for (let k = 0; k < stored.intruders; k++) flight.others.push(track(states));
    flight.separation = next(stored.steps, stored.scale);
    flight.witnessTrack = stored.witness ? track(stored.witness.points) : null;
    flight.turn = next(stored.steps, 1e-3);
    flight.acceleration = next(stored.steps, 1e-3);
    const { bands } = stored;
    flight.bands = bands ? { speed: bands.speed, tracks: rowsOf(bands.tracks, data.tracks_deg.length), speeds: rowsOf(bands.speeds, bands.speed.length), trackAreas: rowsOf(bands.track_areas, data.tracks_deg.length), speedAreas: rowsOf(bands.speed_areas, bands.speed.length) } : null;
    flight.closest = 1 + flight.separation.indexOf(Math.min(...flight.separation));
    return flight;
  }

  // Runs of a code and how often it follows, as rows of codes.
  function rowsOf(runs, width) {
    const flat = [];
    for (let i = 0; i < runs.length; i += 2) for (let n = 0; n < runs[i + 1]; n++) flat.push(runs[i]);
    return Array.from({ length: flat.length / width }, (_, row) => flat.slice(row * width, (row + 1) * width));
  }

  // The bands of this moment, north up: the ring of the display, and its tape.
  function drawBands() {
    const bands = state.flight?.bands;
    $("bands").hidden = !bands;
    if (!bands) return;
    const tracks = bands.tracks[state.time], speeds = bands.speeds[state.time], own = state.flight.own;
    const canvas = document.querySelector("#bands canvas"), box = canvas.parentElement;
    const { pen, width, height } = airmap.fitted({ canvas, box }), radius = Math.min(width - 80, height) / 2 - 26;
    const x = width - radius - 28, y = height / 2, at = Math.max(0, Math.min(state.time, own.x.length - 2));
    // Bands are those of the air mass, and so are the ownship's direction and speed beside them.
    const [east, north] = state.flight.wind ?? [0, 0];
    const vx = (own.x[at + 1] - own.x[at]) / data.dt - east, vy = (own.y[at + 1] - own.y[at]) / data.dt - north, speed = Math.hypot(vx, vy);
    airmap.compass(pen, x, y, radius, 0, colour, 11);
    airmap.bands(pen, x, y, radius + 2, 18, 0, data.tracks_deg, tracks, colour);
    airmap.fences(pen, x, y, radius + 23, 0, data.tracks_deg, bands.trackAreas[state.time], colour);
    airmap.plane(pen, x, y, Math.atan2(vy, vx), 1.2, colour.own, colour.paper);
    const tape = { value: speed, span: 40, step: 10, words: speed.toFixed(0), targets: bands.speed, regions: speeds, areas: bands.speedAreas[state.time] };
    airmap.tape(pen, { left: 4, top: 8, width: 62, height: height - 28 }, tape, colour);
    airmap.text(pen, state.flight.wind ? "m/s, air" : "m/s", 8, height - 6, colour.soft, colour.paper, { size: 11, align: "left" });
    const free = (codes) => codes.filter((code) => code === 0).length;
    $("free").textContent = `${free(tracks)} of ${tracks.length} directions and ${free(speeds)} of ${speeds.length} speeds are free.`;
  }

  const line = (track, until) => track.x.slice(0, until).map((x, i) => [x / 1000, track.y[i] / 1000]);
  const at = (track, time) => [track.x[time] / 1000, track.y[time] / 1000];

  function circle([x, y], radius) {
    const around = [];
    for (let i = 0; i <= 72; i++) around.push([x + radius * Math.cos((i * Math.PI) / 36), y + radius * Math.sin((i * Math.PI) / 36)]);
    return around;
  }

  // Symbols point up, which is north.
  function course(track, time) {
    const a = Math.max(0, Math.min(time, track.x.length - 2));
    return (Math.atan2(track.y[a + 1] - track.y[a], track.x[a + 1] - track.x[a]) * 180) / Math.PI - 90;
  }

  // What must be kept from an intruder, m, and what the ring around the nearest, counted in that, is called.
  const requiredOf = (flight, k) => flight.required?.[k] ?? data.required;
  const discName = (flight) => `${flight.required ? "required separation" : `${data.required} m`} around the nearest`;

  function nearest(flight, time) {
    const apart = flight.others.map((other) => Math.hypot(other.x[time] - flight.own.x[time], other.y[time] - flight.own.y[time]));
    const counted = apart.map((metres, k) => metres / requiredOf(flight, k));
    return counted.indexOf(Math.min(...counted));
  }

  const stroke = (id, name, points, color, more = {}) => ({
    id, name, type: "line", data: points, showSymbol: false, silent: true, animation: false, symbol: "none",
    lineStyle: { color, width: 2, ...more }, itemStyle: { color }, z: more.z ?? 3,
  });

  function bounds(flight) {
    const box = [Infinity, -Infinity, Infinity, -Infinity];
    const include = (x, y) => {
      box[0] = Math.min(box[0], x); box[1] = Math.max(box[1], x); box[2] = Math.min(box[2], y); box[3] = Math.max(box[3], y);
    };
    const all = [flight.own, ...flight.others, flight.witnessTrack].filter(Boolean);
    for (const edge of areaEdges(flight, 0)) edge.forEach(([x, y]) => include(x, y));
    for (const track of all) track.x.forEach((x, i) => include(x / 1000, track.y[i] / 1000));
    for (const edge of circle(flight.goal.map((metres) => metres / 1000), data.goal_radius / 1000)) include(...edge);
    // The same scale both ways: a turn must look like one.
    const width = $("tracks").clientWidth - 70, height = $("tracks").clientHeight - 110;
    const scale = 1.1 * Math.max((box[1] - box[0]) / width, (box[3] - box[2]) / height, 0.5 / height);
    const mx = (box[0] + box[1]) / 2, my = (box[2] + box[3]) / 2;
    return { x: [mx - (scale * width) / 2, mx + (scale * width) / 2], y: [my - (scale * height) / 2, my + (scale * height) / 2] };
  }

  // Edges of areas as they are at a time, with the first corner again at the end.
  function areaEdges(flight, time) {
    return (flight.areas ?? []).flatMap(({ rings, velocity: [vx, vy] }) =>
      rings.map((ring) => [...ring, ring[0]].map(([px, py]) => [(px + vx * time * data.dt) / 1000, (py + vy * time * data.dt) / 1000])));
  }

  function moving(flight) {
    const time = state.time, close = nearest(flight, time), limit = requiredOf(flight, close) / 1000;
    const craft = (id, track, color) => ({
      id, type: "scatter", symbol: "path://M0-10 L6 8 L0 4 L-6 8Z", symbolSize: [13, 19], symbolRotate: course(track, time), silent: true, animation: false,
      itemStyle: { color, borderColor: colour.paper, borderWidth: 1 }, data: [at(track, time)], z: 10,
    });
    const series = [
      { id: "flown", data: line(flight.own, time + 1) },
      stroke("disc", discName(flight), circle(at(flight.others[close], time), limit), colour.other, { width: 1, type: "dashed", z: 4 }),
      craft("own now", flight.own, colour.own),
    ];
    flight.others.forEach((other, k) => {
      series.push({ id: `other ${k}`, data: line(other, time + 1) }, craft(`other now ${k}`, other, colour.other));
    });
    areaEdges(flight, time).forEach((edge, k) => series.push({ id: `area ${k}`, data: edge }));
    return series;
  }

  function drawTracks() {
    const flight = state.flight;
    if (!flight) { charts.tracks.clear(); return; }
    const style = axisStyle(), { x, y } = bounds(flight);
    const goal = flight.goal.map((metres) => metres / 1000);
    const faint = { width: 1.2, opacity: 0.45 };
    const series = [
      stroke("route", "route", [at(flight.own, 0), goal], colour.route, { type: "dotted", width: 1.4 }),
      stroke("goal", "", circle(goal, data.goal_radius / 1000), colour.goal, { width: 1.5 }),
      { id: "goal centre", name: "goal", type: "scatter", symbol: "circle", symbolSize: 9, silent: true, animation: false, itemStyle: { color: colour.goal }, data: [goal] },
    ];
    areaEdges(flight, state.time).forEach((edge, k) => series.push(stroke(`area ${k}`, "area", edge, colour.area, { width: 2 })));
    if (flight.plan)
      series.push({
        ...stroke("plan", "plan", flight.plan[0].map((px, i) => [px / 1000, flight.plan[1][i] / 1000]), colour.plan, { type: "dashed", width: 1.5 }),
        showSymbol: true, symbol: "diamond", symbolSize: 6,
      });
    if (flight.witnessTrack)
      series.push(stroke("witness", "a flight that resolves it", line(flight.witnessTrack), colour.witness, { type: [8, 4, 2, 4], width: 1.8 }));
    series.push(stroke("whole", "", line(flight.own), colour.own, faint), stroke("flown", "ownship", [], colour.own, { width: 2.6, z: 6 }));
    flight.others.forEach((other, k) => {
      series.push(stroke(`whole ${k}`, "", line(other), colour.other, faint), stroke(`other ${k}`, "intruder", [], colour.other, { z: 5 }));
    });
    const km1 = { ...style.axisLabel, formatter: (v) => `${Number(v.toFixed(1))}`, showMinLabel: false, showMaxLabel: false };
    charts.tracks.setOption({
      animation: false,
      grid: { left: 54, right: 16, top: 54, bottom: 56 },
      legend: { top: 0, left: 0, type: "plain", itemWidth: 26, itemHeight: 11, textStyle: { color: colour.soft, fontSize: 11 }, selectedMode: false, data: legendOf(series) },
      xAxis: { ...style, type: "value", min: x[0], max: x[1], name: "east, km", nameLocation: "middle", nameGap: 26, axisLabel: km1 },
      yAxis: { ...style, type: "value", min: y[0], max: y[1], name: "north, km", nameLocation: "middle", nameGap: 34, axisLabel: km1 },
      series: [],
    }, { notMerge: true });
    const dynamic = moving(flight);
    const merged = new Map(series.map((one) => [one.id, one]));
    for (const one of dynamic) merged.set(one.id, { ...merged.get(one.id), ...one });
    charts.tracks.setOption({ series: [...merged.values()] });
  }

  // Lines are tracks; the goal is a disc, and the required separation a dashed ring, as on the map.
  function legendOf(series) {
    const disc = discName(state.flight);
    const icons = {
      goal: { icon: "circle" },
      [disc]: { icon: "circle", itemStyle: { color: "transparent", borderColor: colour.other, borderWidth: 1.5, borderType: "dashed" } },
    };
    const names = [...new Set([...series.map((one) => one.name), disc])].filter(Boolean);
    return names.map((name) => ({ name, ...icons[name] }));
  }

  function overTime(title, axis) {
    const style = axisStyle();
    return {
      animation: false,
      title: { text: title, left: 0, top: 0, textStyle: { color: colour.soft, fontSize: 12, fontWeight: "normal" } },
      grid: { left: 54, right: 54, top: 28, bottom: 36 },
      xAxis: { ...style, type: "value", min: 0, max: state.flight.steps, name: "s", nameGap: 8, splitLine: { show: false }, axisLine: { ...style.axisLine, onZero: false } },
      yAxis: axis.map((one, i) => ({ ...style, type: "value", axisLabel: { ...style.axisLabel, formatter: (v) => `${Number(v.toFixed(2))}` }, splitLine: i ? { show: false } : style.splitLine, ...one })),
    };
  }

  const cursor = (low, high) => stroke("cursor", "", [[state.time, low], [state.time, high]], colour.ink, { width: 1 });

  function drawCurves() {
    const flight = state.flight;
    if (!flight) { charts.separation.clear(); charts.actions.clear(); return; }
    const apart = flight.separation.map((metres, i) => [i + 1, metres / 1000]);
    const limit = data.required / 1000, highest = Math.max(1.2 * limit, ...apart.map(([, d]) => d));
    charts.separation.setOption({
      ...overTime("smallest separation, km; dashed: required", [{ min: 0, max: Math.ceil(highest) }]),
      series: [
        stroke("separation", "", apart, colour.own),
        stroke("required", "", [[0, limit], [flight.steps, limit]], colour.other, { type: "dashed", width: 1.5 }),
        cursor(0, Math.ceil(highest)),
      ],
    }, { notMerge: true });
    const round = (largest, step) => Math.max(step, Math.ceil(largest / step - 1e-6) * step);
    const turns = round(Math.max(...flight.turn.map(Math.abs)), 1), pushes = round(Math.max(...flight.acceleration.map(Math.abs)), 0.1);
    const held = (values) => [...values, values[values.length - 1]].map((value, i) => [i, value]);
    const how = data.commanded ? "commanded" : "as flown";
    charts.actions.setOption({
      ...overTime(`${how}: turn rate, °/s, left positive (solid, left axis); acceleration, m/s² (dashed, right axis)`, [
        { min: -turns, max: turns, interval: turns / 2 },
        { min: -pushes, max: pushes, interval: pushes / 2 },
      ]),
      series: [
        { ...stroke("turn", "", held(flight.turn), colour.own, { width: 1.7 }), step: "end" },
        { ...stroke("acceleration", "", held(flight.acceleration), colour.witness, { type: "dashed", width: 1.5 }), step: "end", yAxisIndex: 1 },
        cursor(-turns, turns),
      ],
    }, { notMerge: true });
  }

  function drawFlight() {
    drawTracks();
    drawCurves();
    showMoment();
  }

  function showMoment() {
    const flight = state.flight, time = state.time;
    $("time").value = String(time);
    $("clock").textContent = `${time} s`;
    $("time").setAttribute("aria-valuetext", `${time} seconds`);
    drawBands();
    if (!flight) { $("moment").textContent = ""; return; }
    const k = Math.min(time, flight.steps - 1), close = nearest(flight, time);
    const apart = Math.hypot(flight.others[close].x[time] - flight.own.x[time], flight.others[close].y[time] - flight.own.y[time]);
    const turn = flight.turn[k], side = Math.abs(turn) < 0.05 ? "straight" : `${Math.abs(turn).toFixed(1)} °/s ${turn > 0 ? "left" : "right"}`;
    $("moment").textContent = `distance ${apart.toFixed(0)} m · turn ${side} · acceleration ${flight.acceleration[k].toFixed(2)} m/s²`;
  }

  function seek(time) {
    const flight = state.flight;
    if (!flight) return;
    state.time = Math.max(0, Math.min(flight.steps, Math.round(time)));
    charts.tracks.setOption({ series: moving(flight) });
    for (const name of ["separation", "actions"]) {
      const [low, high] = [[0, 1e3], [-1e3, 1e3]][Number(name === "actions")];
      charts[name].setOption({ series: [{ id: "cursor", data: [[state.time, low], [state.time, high]] }] });
    }
    showMoment();
  }

  function stop() {
    clearInterval(state.timer);
    state.timer = null;
    $("play").textContent = "Play";
    $("play").setAttribute("aria-pressed", "false");
  }

  function play() {
    if (state.timer !== null) { stop(); return; }
    if (state.time >= state.flight.steps) seek(0);
    $("play").textContent = "Pause";
    $("play").setAttribute("aria-pressed", "true");
    let clock = state.time, before = performance.now();
    state.timer = setInterval(() => {
      const now = performance.now();
      clock += ((now - before) / 1000) * Number($("speed").value);
      before = now;
      seek(clock);
      if (state.time >= state.flight.steps) stop();
    }, 50);
  }

  // Everything together

  function drawAll() {
    for (const chart of Object.values(charts)) chart.resize();
    drawPoints();
    drawFlight();
  }

  applyTheme();
  for (const id of ["polar", "plane", "tracks", "separation", "actions"]) charts[id] = echarts.init($(id), null, { renderer: "canvas" });
  for (const id of ["polar", "plane"])
    charts[id].on("click", (point) => { if (point.seriesId.startsWith("kind")) choose(numbers[point.data[2]]); });
  for (const id of ["separation", "actions"])
    charts[id].getZr().on("click", (event) => {
      if (state.flight) seek(charts[id].convertFromPixel({ xAxisIndex: 0 }, event.offsetX));
    });
  $("filter").addEventListener("change", filter);
  $("filter").addEventListener("submit", (event) => event.preventDefault());
  $("order").addEventListener("change", fillList);
  $("list").addEventListener("change", () => choose(Number($("list").value)));
  $("previous").addEventListener("click", () => move(-1));
  $("next").addEventListener("click", () => move(1));
  $("goto").addEventListener("change", () => { if ($("goto").value !== "") choose(Number($("goto").value)); });
  $("time").addEventListener("input", () => { stop(); seek(Number($("time").value)); });
  $("play").addEventListener("click", play);
  $("theme").addEventListener("click", () => {
    wish = document.documentElement.dataset.theme === "dark" ? "light" : "dark";
    applyTheme();
  });
  system.addEventListener("change", applyTheme);
  paper.addEventListener("change", applyTheme);
  for (const [event, now] of [["beforeprint", true], ["afterprint", false]])
    addEventListener(event, () => { printing = now; applyTheme(); });
  let resizing = null;
  addEventListener("resize", () => { clearTimeout(resizing); resizing = setTimeout(drawAll, 120); });
  addEventListener("hashchange", () => { if (/^#\d+$/.test(location.hash)) choose(Number(location.hash.slice(1))); });

  for (const id of ["play", "time", "speed"]) $(id).disabled = true;
  filter();
  const asked = /^#\d+$/.test(location.hash) ? Number(location.hash.slice(1)) : null;
  if (asked !== null) choose(asked);
  else if ($("list").length) choose(Number($("list").options[0].value));
  document.documentElement.dataset.ready = Math.round(performance.now());
})();
