// What else the ownship could do: simple manoeuvres, flown against traffic that holds its course.
// A manoeuvre that keeps the separation shows that one exists; that none of these does proves nothing.
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
const beginSearch = (planes) => ({ planes, next: 0, best: null, distance: -Infinity, done: false });

function searchOn(search, until, dt, aircraft, steps) {
  while (search.next < CANDIDATES.length && performance.now() < until) {
    const candidate = CANDIDATES[search.next++];
    const distance = separationOf(candidate, search.planes, dt, aircraft, steps, search.distance);
    if (distance > search.distance) Object.assign(search, { best: candidate, distance });
  }
  search.done = search.next === CANDIDATES.length;
}
