// What else the ownship could do: simple manoeuvres, flown against traffic that holds its course.
// A manoeuvre that keeps the separation shows that one exists; that none of these does proves nothing, `unavoidable` does.
"use strict";

const TURNS = Array.from({ length: 37 }, (_, i) => ((i - 18) * Math.PI) / 18); // every 10 degrees, left is positive
const CANDIDATES = [0, -1, 1].flatMap((throttle) => TURNS.map((turn) => ({ turn, throttle })));

// The least distance to any other aircraft when the ownship turns as fast as it can, then flies straight on.
// Given up, and then too large, where it is below `enough`.
function separationOf({ turn, throttle }, planes, dt, { limits }, steps, enough) {
  const most = limits.yaw_rate_max * dt;
  let [own, ...others] = planes, left = turn, least = Infinity;
  for (let step = 0; step < steps && least > enough; step++) {
    const steering = clip(left / most, -1, 1);
    left -= steering * most;
    const ownNext = advance(own, [throttle, steering], dt, limits);
    const othersNext = others.map((one) => advance(one, [0, 0], dt, limits));
    for (let k = 0; k < others.length; k++) {
      least = Math.min(least, closest(own, ownNext, others[k], othersNext[k], dt)[0]);
    }
    own = ownNext;
    others = othersNext;
  }
  return least;
}

// A search from some aircraft, the ownship first, that goes on in `searchOn` until it is done.
const beginSearch = (planes, aircraft) => (
  { planes, next: 0, best: null, distance: -Infinity, done: false, lost: unavoidable(planes, aircraft) });

function searchOn(search, until, dt, aircraft, steps) {
  while (search.next < CANDIDATES.length && performance.now() < until) {
    const candidate = CANDIDATES[search.next++];
    const distance = separationOf(candidate, search.planes, dt, aircraft, steps, search.distance);
    if (distance > search.distance) Object.assign(search, { best: candidate, distance });
  }
  search.done = search.next === CANDIDATES.length;
}

// Whether no manoeuvre at all keeps the separation: at some time, before the goal can be reached, every place where the
// ownship may be then is too near to one of the others, who hold their course.
// These places lie in a rectangle ahead of it, until it can have turned by 90 degrees: never faster than the greatest
// speed that it can have by then, never slower than the lowest, and turned no further than it can have turned.
function unavoidable([own, ...others], { limits, goal_radius }) {
  const { yaw_rate_max: rate, acceleration_min, acceleration_max, speed_min, speed_max } = limits;
  const toGoal = Math.hypot(own.goalX - own.x, own.goalY - own.y) - goal_radius;
  const cosine = Math.cos(own.heading), sine = Math.sin(own.heading), enough = 1 - 1e-9;
  for (let part = 1; part <= 200; part++) {
    const turned = (part / 200) * (Math.PI / 2), time = turned / rate;
    const fast = Math.min(speed_max, own.speed + acceleration_max * time);
    const slow = Math.max(speed_min, own.speed + acceleration_min * time);
    if (fast * time >= toGoal) return false;
    const near = (slow * Math.sin(turned)) / rate, far = fast * time, aside = (fast * (1 - Math.cos(turned))) / rate;
    const caught = others.some((one) => {
      const x = one.x + one.speed * time * Math.cos(one.heading) - own.x;
      const y = one.y + one.speed * time * Math.sin(one.heading) - own.y;
      const ahead = x * cosine + y * sine, left = y * cosine - x * sine;
      return Math.hypot(Math.max(Math.abs(near - ahead), Math.abs(far - ahead)), aside + Math.abs(left)) < enough;
    });
    if (caught) return true;
  }
  return false;
}
