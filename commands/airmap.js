// What the pages of the toolkit draw alike on a canvas: aircraft, marks of traffic, bands, ring, tape, labels.
// Used by the traffic display, by the page Fly and by the replay of the report; no library, no module loader.
// Lengths are px, angles on the screen rad clockwise from up; levels and regions are codes of agents.assurance.alerts.
"use strict";

const airmap = (() => {
  const TURN = 2 * Math.PI, FONT = "system-ui, 'Segoe UI', 'Liberation Sans', sans-serif";
  const PLANE = new Path2D(["", "-"].map((side) => // seen from above, nose to the right, both sides of it
    `M10 0C9.4 ${side}1 6 ${side}1.2 3 ${side}1.3L-2.2 ${side}9.2-4.4 ${side}9.2-1.8 ${side}1.3-6.4 ${side}.9-8.4 ${side}3.6-9.8 ${side}3.6-8.9 0Z`).join(""));
  const REGIONS = ["free", "preventive", "corrective", "warning", "recovery"];
  const WIDTHS = [0.12, 0.4, 0.7, 1, 0.55]; // of the ring: what is more urgent is wider, whatever its colour

  const clip = (value, low, high) => Math.min(high, Math.max(low, value));
  const tint = (colour, alpha) => `color-mix(in srgb, ${colour} ${Math.round(100 * alpha)}%, transparent)`;
  const onRing = (x, y, radius, angle) => [x + radius * Math.sin(angle), y - radius * Math.cos(angle)];

  // The canvas as large as its box, in px of the page, cleared; at most twice as fine.
  function fitted({ canvas, box }) {
    const ratio = Math.min(window.devicePixelRatio || 1, 2), width = box.clientWidth, height = box.clientHeight;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    return { pen, width, height };
  }

  function stroke(pen, colour, thickness, dash = []) {
    pen.strokeStyle = colour;
    pen.lineWidth = thickness;
    pen.setLineDash(dash);
    pen.stroke();
  }

  function line(pen, points) {
    pen.beginPath();
    for (const [x, y] of points) pen.lineTo(x, y);
  }

  function circle(pen, x, y, radius) {
    pen.beginPath();
    pen.arc(x, y, radius, 0, TURN);
  }

  // A text with a rim, so that it reads on whatever is under it.
  function text(pen, words, x, y, colour, rim, { size = 13, weight = 600, align = "center" } = {}) {
    pen.font = `${weight} ${size}px ${FONT}`;
    pen.textAlign = align;
    pen.lineJoin = "round";
    pen.lineWidth = 4;
    pen.setLineDash([]);
    pen.strokeStyle = rim;
    pen.strokeText(words, x, y);
    pen.fillStyle = colour;
    pen.fillText(words, x, y);
  }

  // An aircraft seen from above; the angle is that of its nose, rad counter-clockwise from the right.
  function plane(pen, x, y, angle, size, colour, rim) {
    pen.save();
    pen.translate(x, y);
    pen.rotate(-angle);
    pen.scale(size, size);
    pen.lineWidth = 2.5;
    pen.setLineDash([]);
    pen.strokeStyle = rim;
    pen.stroke(PLANE);
    pen.fillStyle = colour;
    pen.fill(PLANE);
    pen.restore();
  }

  // The outline of traffic by its alert level: diamond, diamond, disc, square.
  function outline(pen, x, y, level, size) {
    pen.beginPath();
    if (level >= 3) return pen.rect(x - size, y - size, 2 * size, 2 * size);
    if (level === 2) return pen.arc(x, y, size * 1.1, 0, TURN);
    const reach = 1.3 * size;
    for (const [dx, dy] of [[0, -reach], [reach, 0], [0, reach], [-reach, 0]]) pen.lineTo(x + dx, y + dy);
    pen.closePath();
  }

  // Traffic by its alert level, filled where it has one or is near (proximate); a tip points where it flies, rad from up.
  // Where its reports are late it is dashed, and filled in the middle only.
  function mark(pen, x, y, level, size, colour, rim, { late = false, proximate = false, points = null } = {}) {
    if (points !== null) {
      const reach = 1.45 * size, [ax, ay] = onRing(x, y, reach + 7, points);
      line(pen, [[ax, ay], onRing(x, y, reach - 2, points - 0.55), onRing(x, y, reach - 2, points + 0.55)]);
      pen.closePath();
      pen.fillStyle = colour;
      pen.fill();
      stroke(pen, rim, 1);
    }
    outline(pen, x, y, level, size);
    const filled = (level > 0 || proximate) && !late;
    pen.fillStyle = filled ? colour : rim;
    pen.fill();
    stroke(pen, filled ? rim : colour, filled ? 1.5 : 2.2, late ? [3, 3] : []);
    if (!late || (level === 0 && !proximate)) return;
    outline(pen, x, y, level, 0.5 * size);
    pen.fillStyle = colour;
    pen.fill();
  }

  // Neighbouring targets of one region as arcs: [from, to, region], degrees; targets stand evenly on the circle.
  function arcs(targets, regions) {
    const half = 180 / targets.length, found = [];
    targets.forEach((target, n) => {
      const before = found.at(-1);
      if (before && before[2] === regions[n]) before[1] = target + half;
      else found.push([target - half, target + half, regions[n]]);
    });
    if (found.length > 1 && found[0][2] === found.at(-1)[2]) found[0][0] = found.pop()[0] - 360;
    return found;
  }

  // The bands on a ring of some width outside a radius; what is up on the screen is `up`, degrees from true north.
  function bands(pen, x, y, radius, width, up, targets, regions, colours) {
    for (const [from, to, region] of arcs(targets, regions)) {
      const [a, b] = [from, to].map((degrees) => ((degrees - up - 90) * Math.PI) / 180);
      const thick = width * WIDTHS[region], name = REGIONS[region];
      pen.beginPath();
      pen.arc(x, y, radius + thick / 2, a, b);
      pen.lineCap = "butt";
      stroke(pen, colours[name], thick, region === 4 ? [6, 3] : []);
      if (region < 3) continue;
      pen.save(); // teeth, so that a warning and the way out differ from the rest without their colour
      pen.beginPath();
      for (let angle = a; angle < b; angle += 0.07) {
        const [cosine, sine] = [Math.cos(angle), Math.sin(angle)];
        pen.moveTo(x + radius * cosine, y + radius * sine);
        pen.lineTo(x + (radius + thick) * cosine, y + (radius + thick) * sine);
      }
      if (region === 3) stroke(pen, colours.paper, 1.6);
      pen.restore();
    }
  }

  // What areas close: a chain of dots outside the bands, so that it is told from traffic without its colour.
  function fences(pen, x, y, radius, up, targets, areas, colours) {
    const by = Array.from(areas ?? [], (area) => (area < 0 ? 0 : 1));
    for (const [from, to, area] of by.length ? arcs(targets, by) : []) {
      if (!area) continue;
      const [a, b] = [from, to].map((degrees) => ((degrees - up - 90) * Math.PI) / 180);
      pen.beginPath();
      pen.arc(x, y, radius, a, b);
      pen.lineCap = "round";
      stroke(pen, colours.paper, 6.5);
      stroke(pen, colours.area, 4, [0.1, 7]);
      pen.lineCap = "butt";
    }
  }

  // A compass ring: ticks every 10 degrees, numbers every 30, north by its letter.
  function compass(pen, x, y, radius, up, colours, size = 13) {
    circle(pen, x, y, radius);
    stroke(pen, colours.soft, 1.2);
    for (let degrees = 0; degrees < 360; degrees += 10) {
      const angle = ((degrees - up) * Math.PI) / 180, long = degrees % 30 === 0 ? 10 : 5;
      line(pen, [onRing(x, y, radius, angle), onRing(x, y, radius - long, angle)]);
      stroke(pen, colours.soft, 1.4);
      if (degrees % 30) continue;
      const letters = { 0: "N", 90: "E", 180: "S", 270: "W" }[degrees] ?? String(degrees / 10).padStart(2, "0");
      const [tx, ty] = onRing(x, y, radius - 20, angle);
      text(pen, letters, tx, ty + size / 3, degrees % 90 ? colours.soft : colours.ink, colours.paper, { size });
    }
  }

  // A triangle on the ring that points inwards at a direction, degrees; open: only its outline.
  function bug(pen, x, y, radius, up, degrees, colour, rim, open = false) {
    const angle = ((degrees - up) * Math.PI) / 180;
    line(pen, [onRing(x, y, radius - 1, angle), onRing(x, y, radius + 13, angle - 0.055), onRing(x, y, radius + 13, angle + 0.055)]);
    pen.closePath();
    pen.fillStyle = open ? rim : colour;
    pen.fill();
    stroke(pen, open ? colour : rim, open ? 2.4 : 1.2);
  }

  // A vertical tape of values, the present one in a box in the middle; bands at its right edge.
  function tape(pen, { left, top, width, height }, { value, span, step, words, targets = [], regions = [], areas = [], wanted = null, signed = false }, colours) {
    const middle = top + height / 2, y = (one) => middle - ((one - value) / span) * height;
    pen.save();
    pen.beginPath();
    pen.rect(left, top, width, height);
    pen.clip();
    pen.fillStyle = colours.paper;
    pen.fillRect(left, top, width, height);
    const half = targets.length > 1 ? (targets.at(-1) - targets[0]) / (targets.length - 1) / 2 : 0;
    targets.forEach((target, n) => {
      const thick = 14 * WIDTHS[regions[n]];
      pen.fillStyle = colours[REGIONS[regions[n]]];
      pen.fillRect(left + width - thick, y(target + half), thick, y(target - half) - y(target + half) + 0.5);
      if (!(areas[n] >= 0)) return;
      circle(pen, left + width - 3, y(target), 2);
      pen.fillStyle = colours.area;
      pen.fill();
      stroke(pen, colours.paper, 0.8);
    });
    for (let one = Math.ceil((value - span / 2) / step) * step; one <= value + span / 2; one += step) {
      if ((one < 0 && !signed) || Math.abs(y(one) - middle) > height / 2 - 8) continue; // cut by the edge
      line(pen, [[left + width - 16, y(one)], [left + width - 24, y(one)]]);
      stroke(pen, colours.soft, 1.4);
      if (Math.abs(y(one) - middle) < 21) continue; // under the box
      text(pen, whole(one), left + width - 28, y(one) + 4, colours.ink, colours.paper, { size: 13, weight: 400, align: "right" });
    }
    if (wanted !== null) {
      const at = clip(y(wanted), top + 4, top + height - 4);
      line(pen, [[left + width - 16, at], [left + width, at - 8], [left + width, at + 8]]);
      pen.closePath();
      pen.fillStyle = colours.plan;
      pen.fill();
      stroke(pen, colours.paper, 1);
    }
    pen.restore();
    pen.beginPath();
    pen.rect(left, top, width, height);
    stroke(pen, colours.line, 1);
    pen.beginPath();
    pen.rect(left + 2, middle - 14, width - 18, 28);
    pen.fillStyle = colours.paper;
    pen.fill();
    stroke(pen, colours.ink, 2);
    text(pen, words, left + width / 2 - 7, middle + 6, colours.ink, colours.paper, { size: words.length > 4 ? 14 : 17, weight: 700 });
  }

  // Where a text of some width stands clear of discs around some points: near a place, and on the map.
  function clearPlace([x, y], across, points, { width, height, disc }) {
    const half = across / 2 + 4;
    let best = { room: -Infinity };
    for (const reach of [1.2, 1.8, 2.6]) {
      for (const way of [90, -90, 0, 180, 45, 135, -45, -135]) {
        const radians = (way * Math.PI) / 180;
        const tx = clip(x + Math.cos(radians) * (reach * disc + half), half, width - half);
        const ty = clip(y - Math.sin(radians) * (reach * disc + 10), 18, height - 34);
        const room = Math.min(...points.map(([px, py]) => Math.hypot(Math.max(Math.abs(px - tx) - half, 0), Math.max(Math.abs(py - ty + 5) - 9, 0))));
        if (room >= disc) return [tx, ty];
        if (room > best.room) best = { room, at: [tx, ty] };
      }
    }
    return best.at;
  }

  // A number without its fraction, with the sign that typographers write.
  const whole = (value) => `${Math.round(value) < 0 ? "−" : ""}${Math.abs(Math.round(value))}`;

  // The largest of 1, 2, 5, 10 ... that is not more.
  function round(most) {
    const power = 10 ** Math.floor(Math.log10(most));
    return [5, 2, 1].find((digit) => digit * power <= most * 1.0001) * power;
  }

  return { FONT, PLANE, REGIONS, arcs, bands, bug, circle, clearPlace, clip, compass, fences, fitted, line, mark, onRing, plane, round, stroke, tape, text, tint, whole };
})();
