// Areas to be kept out of: discs {x, y, radius}, and polygons, which are the smallest disc about them with their corners
// from its middle and the discs, likewise, that the policy sees them as (eval/flights/static_obstacles.py).
"use strict";

const PIECES_OF_STEP = 4; // chords that a step's way is taken for, at polygons
const LARGEST = 2, CUTS = 4; // D, radius of a disc that is not cut further; times that a polygon is cut in two at most

const shift = (places, x, y) => places.map(([px, py]) => [px + x, py + y]);
const cornersOf = ({ x, y, corners }) => shift(corners, x, y);

// The discs that the policy sees an area as.
const discsOf = ({ x, y, radius, discs }) => discs?.map((one) => ({ x: x + one.x, y: y + one.y, radius: one.radius })) ?? [{ x, y, radius }];

function polygonOf(places, smallest) { // with a disc of a radius of at least `smallest`
  const { x, y, radius } = discAbout(places);
  return resized({ x, y, radius, corners: shift(places, -x, -y) }, Math.max(radius, smallest));
}

function resized(area, radius) {
  if (!area.corners) return { ...area, radius };
  const times = radius / area.radius, corners = area.corners.map(([x, y]) => [times * x, times * y]);
  return { ...area, radius, corners, discs: discsAbout(corners, CUTS) };
}

// The smallest disc about a polygon, or, where that is too large, those about its two parts, cut across where it is longest.
function discsAbout(places, cuts) {
  const disc = discAbout(places);
  if (disc.radius <= LARGEST || cuts === 0) return [disc];
  const mean = (values) => values.reduce((sum, value) => sum + value, 0) / values.length;
  const off = shift(places, -mean(places.map(([x]) => x)), -mean(places.map(([, y]) => y)));
  const angle = 0.5 * Math.atan2(2 * mean(off.map(([x, y]) => x * y)), mean(off.map(([x, y]) => x * x - y * y)));
  const along = off.map(([x, y]) => x * Math.cos(angle) + y * Math.sin(angle));
  const middle = 0.5 * (Math.min(...along) + Math.max(...along)), far = along.map((value) => value - middle);
  return [far, far.map((value) => -value)].flatMap((side) => discsAbout(half(places, side), cuts - 1));
}

// The part of a polygon on one side of a line: how far from it the corners are is not negative there.
function half(places, far) {
  return places.flatMap(([x, y], n) => {
    const before = (n || places.length) - 1, [fromX, fromY] = places[before], share = far[n] / (far[n] - far[before]);
    const cut = far[n] * far[before] < 0 ? [[x + share * (fromX - x), y + share * (fromY - y)]] : [];
    return far[n] >= 0 ? [...cut, [x, y]] : cut;
  });
}

// The smallest disc about some places: what lies outside of the disc so far lies on the edge of the next.
function discAbout(places) {
  const has = (disc, [x, y]) => Math.hypot(x - disc.x, y - disc.y) <= disc.radius * (1 + 1e-9) + 1e-12;
  let disc = through(places[0], places[0]);
  places.forEach((a, i) => {
    if (has(disc, a)) return;
    disc = through(a, a);
    places.slice(0, i).forEach((b, k) => {
      if (has(disc, b)) return;
      disc = through(a, b);
      for (const c of places.slice(0, k)) if (!has(disc, c)) disc = around(a, b, c);
    });
  });
  return disc;
}

const through = ([ax, ay], [bx, by]) => ({ x: (ax + bx) / 2, y: (ay + by) / 2, radius: Math.hypot(bx - ax, by - ay) / 2 });

function around([ax, ay], [bx, by], [cx, cy]) { // the disc with three places on its edge
  const [px, py, qx, qy] = [bx - ax, by - ay, cx - ax, cy - ay], twice = 2 * (px * qy - py * qx);
  const p = px * px + py * py, q = qx * qx + qy * qy, x = (qy * p - py * q) / twice, y = (px * q - qx * p) / twice;
  return { x: ax + x, y: ay + y, radius: Math.hypot(x, y) };
}

// Whether a place is inside, where edges that cross turn the inside out (as the canvas fills them).
function inPolygon(corners, [x, y]) {
  let inside = false;
  corners.forEach(([ax, ay], i) => {
    const [bx, by] = corners[(i + 1) % corners.length];
    if (ay > y !== by > y && x < ax + ((y - ay) / (by - ay)) * (bx - ax)) inside = !inside;
  });
  return inside;
}

// At which share of the way from one place to another the first edge is met; null: at none.
function meets([ax, ay], [bx, by], corners) {
  const wayX = bx - ax, wayY = by - ay;
  const shares = corners.map(([cx, cy], i) => {
    const [dx, dy] = corners[(i + 1) % corners.length], edgeX = dx - cx, edgeY = dy - cy;
    const cross = wayX * edgeY - wayY * edgeX;
    const share = ((cx - ax) * edgeY - (cy - ay) * edgeX) / cross, along = ((cx - ax) * wayY - (cy - ay) * wayX) / cross;
    return share >= 0 && share <= 1 && along >= 0 && along <= 1 ? share : Infinity; // parallel ones give no number
  });
  const first = Math.min(...shares);
  return first <= 1 ? first : null;
}

// When in a step from `one` to `next` an aircraft enters an area, as a share of the step; null: it does not.
function entersAt(area, one, action, next, dt, limits) {
  if (!area.corners) {
    const still = { ...area, heading: 0, speed: 0 }, [distance, part] = closest(one, next, still, still, dt);
    return distance < area.radius ? part : null;
  }
  const corners = cornersOf(area);
  if (inPolygon(corners, [one.x, one.y])) return 0;
  let before = [one.x, one.y];
  for (let piece = 0; piece < PIECES_OF_STEP; piece++) {
    const { x, y } = advance(one, action, ((piece + 1) / PIECES_OF_STEP) * dt, limits), share = meets(before, [x, y], corners);
    if (share !== null) return (piece + share) / PIECES_OF_STEP;
    before = [x, y];
  }
  return null;
}
