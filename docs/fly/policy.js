// The policy and the motion of aircraft in the browser: what agents/policy and envs/kinematics compute, for one scene.
// Numbers of the network are in weights.js, which docs/fly/make.py writes; tests/test_fly.py compares with numpy.
// An aircraft is {limits, separation}, a state {x, y, heading, speed}, of an intruder with separation, too, where it has
// one of its own; SI, or any units that fit together.
"use strict";

const clip = (value, low, high) => Math.min(high, Math.max(low, value));
const soft = (value) => value / (1 + Math.abs(value));

const network = (() => {
  const bytes = Uint8Array.from(atob(WEIGHTS.data), (letter) => letter.charCodeAt(0));
  let at = 0;
  const take = (count) => new Float32Array(bytes.buffer, (at += 4 * count) - 4 * count, count);
  const layers = WEIGHTS.layers.map(([name, inputs, outputs]) => {
    const kernel = Float64Array.from(take(inputs * outputs)), bias = Float64Array.from(take(outputs));
    return { name, inputs, outputs, kernel, bias, values: new Float64Array(outputs) };
  });
  return {
    encoder: layers.filter((layer) => layer.name.startsWith("each")),
    trunk: layers.filter((layer) => layer.name.startsWith("hidden")),
    head: layers.at(-1),
    size: layers.reduce((sum, layer) => sum + (layer.inputs + 1) * layer.outputs, 0),
  };
})();

function dense(layer, input, squash) {
  const { inputs, outputs, kernel, values } = layer;
  values.set(layer.bias);
  let i = 0, at = 0;
  for (; i + 4 <= inputs; i += 4, at += 4 * outputs) { // four rows at a time: more than twice as fast
    const a = input[i], b = input[i + 1], c = input[i + 2], d = input[i + 3];
    for (let o = at, out = 0; out < outputs; o++, out++) {
      values[out] += a * kernel[o] + b * kernel[o + outputs] + c * kernel[o + 2 * outputs] + d * kernel[o + 3 * outputs];
    }
  }
  for (; i < inputs; i++, at += outputs) for (let o = 0; o < outputs; o++) values[o] += input[i] * kernel[at + o];
  if (squash) for (let o = 0; o < outputs; o++) values[o] = Math.tanh(values[o]);
  return values;
}

// agents/policy/scene.py: lengths in separations, speeds in the greatest speed, x ahead and y to the left; of an intruder
// x, y, its velocity, and the share: the aircraft's separation over its own, at which its distance counts.
function sceneOf(own, intruders, goalX, goalY, { limits, separation }) {
  const sine = Math.sin(own.heading), cosine = Math.cos(own.heading);
  const turned = (x, y) => [x * cosine + y * sine, y * cosine - x * sine];
  const place = (x, y) => {
    const [ahead, left] = turned((x - own.x) / separation, (y - own.y) / separation);
    const pulled = Math.min(1, 20 / Math.max(Math.hypot(ahead, left), 1e-6));
    return [ahead * pulled, left * pulled];
  };
  const unit = separation / limits.speed_max ** 2;
  return {
    speed: own.speed / limits.speed_max,
    goal: place(goalX, goalY),
    intruders: intruders.map((one) => {
      const pace = one.speed / limits.speed_max;
      const velocity = turned(pace * Math.cos(one.heading), pace * Math.sin(one.heading));
      return [...place(one.x, one.y), ...velocity, separation / (one.separation ?? separation)];
    }),
    speedMin: limits.speed_min / limits.speed_max,
    brake: limits.acceleration_min * unit,
    push: limits.acceleration_max * unit,
    radius: limits.speed_max / (limits.yaw_rate_max * separation),
  };
}

// The scene is seen with most of the traffic left of the line to the goal; returns 1, or -1 where it was mirrored.
function mirror(scene) {
  const [goalX, goalY] = scene.goal;
  let total = 1e-20 * goalY;
  for (const [x, y, vx, vy, share] of scene.intruders) {
    const rx = vx - scene.speed;
    const time = clip(-(x * rx + y * vy) / (rx * rx + vy * vy + 0.0025), 0, 30);
    const cx = share * (x + rx * time), cy = share * (y + vy * time);
    const weight = 1 / ((1 + 0.1 * time * time) * (1 + cx * cx + cy * cy));
    total += weight * ((goalX * y - goalY * x) / Math.max(Math.hypot(x, y), 1e-3) + 1e-9);
  }
  const sign = total < 0 || Object.is(total, -0) ? -1 : 1;
  scene.goal[1] *= sign;
  for (const one of scene.intruders) (one[1] *= sign), (one[3] *= sign);
  return sign;
}

// agents/policy/candidate_manoeuvres.py: the least separation within 10 units of time of each of 22 simple manoeuvres.
const HORIZON = 10, CURVED = 5, PIECES = 10;
const MANOEUVRES = [];
for (const angle of [25, 55, 90, 150]) {
  for (const side of [1, -1]) for (const throttle of [-1, 1]) MANOEUVRES.push([(side * angle * Math.PI) / 180, throttle]);
}
for (const turn of [0, null]) for (const throttle of [-1, 0, 1]) MANOEUVRES.push([turn, throttle]); // null: to the goal
const OF_REST = [0, 0, 0, 0, 0, 1 / 15, 3 / 15, 6 / 15, 10 / 15, 1];

function minSeparations(scene, bearing) {
  const { speed, intruders, speedMin, brake, push, radius } = scene;
  return MANOEUVRES.map(([fixed, throttle]) => {
    const turn = fixed ?? bearing, rate = throttle < 0 ? -brake * throttle : push * throttle;
    const turning = Math.min(Math.abs(turn) * radius, 0.9 * HORIZON), bent = (0.5 * turn) / CURVED;
    let before = 0, slower = speed, ownX = 0, ownY = 0, least = 1e6;
    for (let piece = 0; piece < PIECES; piece++) {
      const curved = piece < CURVED;
      const time = turning * (curved ? (piece + 1) / CURVED : 1) + (HORIZON - turning) * OF_REST[piece];
      const span = time - before;
      const faster = clip(speed + rate * time, Math.min(speedMin, speed), Math.max(speed, 1));
      const way = 0.5 * (faster + slower) * span * (curved ? 1 - (bent * bent) / 6 : 1);
      const angle = turn * (curved ? (piece + 0.5) / CURVED : 1);
      const stepX = way * Math.cos(angle), stepY = way * Math.sin(angle);
      (ownX += stepX), (ownY += stepY), (before = time), (slower = faster);
      for (const [x0, y0, vx, vy, share] of intruders) {
        let x = x0 + vx * time - ownX, y = y0 + vy * time - ownY;
        const dx = vx * span - stepX, dy = vy * span - stepY;
        const back = clip((x * dx + y * dy) / (dx * dx + dy * dy + 1e-8), 0, 1);
        (x -= back * dx), (y -= back * dy);
        least = Math.min(least, share * share * (x * x + y * y));
      }
    }
    return Math.sqrt(least);
  });
}

// agents/policy/set_features.py: the numbers that the first layers take.
function passing(x, y, vx, vy, share) {
  const square = vx * vx + vy * vy + 0.0025;
  const time = -(x * vx + y * vy) / square, miss = (share * (x * vy - y * vx)) / Math.sqrt(square);
  const ahead = clip(time, 0, 30);
  const closest = share * Math.hypot(x + vx * ahead, y + vy * ahead);
  return [soft(time / 6), soft(miss), clip(0.2 * miss, -1, 1), clip(1.5 - closest, -1, 1.5)];
}

function ownInputs(scene) {
  const { speed, speedMin, brake, push, radius } = scene;
  const [goalX, goalY] = scene.goal;
  const far = Math.hypot(goalX, goalY) + 1e-6, circle = speed * radius, bearing = Math.atan2(goalY, goalX);
  const spare = minSeparations(scene, bearing).map((separation) => soft((separation - 1) / 0.03));
  const most = Math.max(...spare), home = clip(bearing * radius * 10, -1, 1);
  let whole = 0, throttles = 0, turns = 0;
  spare.forEach((value, m) => {
    const behind = (most - value) / 0.05, share = 1 / (1 + behind * behind), turn = MANOEUVRES[m][0];
    (whole += share), (throttles += share * MANOEUVRES[m][1]), (turns += share * (turn === null ? home : Math.sign(turn)));
  });
  return [
    (2 * speed - 1 - speedMin) / (1 - speedMin), speed, goalX / far, goalY / far, 0.1 * far - 1, soft(far),
    soft(2 * (Math.hypot(goalX, goalY - circle) - circle)), soft(2 * (Math.hypot(goalX, goalY + circle) - circle)),
    4 * (speedMin - 0.5), soft(10 * brake), soft(10 * push), soft(radius),
    most, throttles / whole, turns / whole, ...spare,
  ];
}

function intruderInputs([x, y, vx, vy, share], scene) {
  const away = Math.hypot(x, y) + 1e-6, counted = away * share, rx = vx - scene.speed;
  const far = Math.hypot(...scene.goal) + 1e-6, cosine = scene.goal[0] / far, sine = scene.goal[1] / far;
  return [
    x / away, y / away, Math.min(0.1 * counted - 1, 1), soft(counted - 1), vx, vy, rx, (x * rx + y * vy) / away,
    ...passing(x, y, rx, vy, share), ...passing(x, y, vx - scene.speed * cosine, vy - scene.speed * sine, share),
  ];
}

// envs/observation.py: how urgent an intruder is, the most urgent smallest; both aircraft are taken to fly straight on.
function criticality(own, one, { limits, separation }) {
  const share = separation / (one.separation ?? separation), radius = 1.5 * separation, length = 1000 / separation;
  const x = share * (one.x - own.x), y = share * (one.y - own.y), away = Math.hypot(x, y);
  const vx = one.speed * Math.cos(one.heading) - own.speed * Math.cos(own.heading);
  const vy = one.speed * Math.sin(one.heading) - own.speed * Math.sin(own.heading);
  const time = Math.max(0, -(x * vx + y * vy) / Math.max(vx * vx + vy * vy, 1e-9));
  const least = Math.hypot(x + vx * time, y + vy * time);
  if (least >= radius) return 10_000 + least * length;
  if (away < radius) return (least - radius) * length;
  const inside = Math.sqrt(radius ** 2 - least ** 2), travelled = Math.sqrt(Math.max(away ** 2 - least ** 2, 1e-9));
  return Math.max(0, time * (1 - inside / travelled)) * ((10 * limits.speed_max) / separation);
}

// The intruders that the policy looks at: the most urgent, as many as in training.
function urgent(own, intruders, aircraft) {
  if (intruders.length <= WEIGHTS.most) return intruders;
  const ranked = intruders.map((one) => ({ one, rank: criticality(own, one, aircraft) }));
  return ranked.sort((a, b) => a.rank - b.rank).slice(0, WEIGHTS.most).map(({ one }) => one);
}

// What Policy.command returns: acceleration and yaw rate in limits, each in [-1, 1].
function command(own, intruders, goalX, goalY, aircraft) {
  const scene = sceneOf(own, urgent(own, intruders, aircraft), goalX, goalY, aircraft), sign = mirror(scene);
  const pooled = new Float64Array(network.encoder.at(-1).outputs).fill(-1);
  for (const one of scene.intruders) {
    const values = network.encoder.reduce((input, layer) => dense(layer, input, true), intruderInputs(one, scene));
    for (let i = 0; i < pooled.length; i++) pooled[i] = Math.max(pooled[i], values[i]);
  }
  const [throttle, steering] = dense(
    network.head, network.trunk.reduce((input, layer) => dense(layer, input, true), [...ownInputs(scene), ...pooled]), false,
  );
  return [clip(throttle, -1, 1), clip(steering * sign, -1, 1)];
}

// envs/kinematics.py: exact motion under constant acceleration and yaw rate; the speed stops at its limit.
function advance(state, [throttle, steering], dt, limits) {
  const acceleration = throttle * (throttle < 0 ? -limits.acceleration_min : limits.acceleration_max);
  const yawRate = steering * limits.yaw_rate_max;
  const gap = (acceleration > 0 ? limits.speed_max : limits.speed_min) - state.speed;
  const accelerated = acceleration === 0 ? 0 : clip(gap / acceleration, 0, dt);
  const moved = { ...state, speed: state.speed + acceleration * accelerated };
  arc(moved, state.speed, acceleration, yawRate, accelerated);
  arc(moved, moved.speed, 0, yawRate, dt - accelerated);
  moved.heading -= 2 * Math.PI * Math.floor((moved.heading + Math.PI) / (2 * Math.PI));
  return moved;
}

function arc(state, speed, acceleration, yawRate, duration) {
  const half = 0.5 * duration, theta = yawRate * half, small = Math.abs(theta) < 1e-3;
  const along = duration * (speed + acceleration * half) * (small ? 1 - (theta * theta) / 6 : Math.sin(theta) / theta);
  const slant = small ? theta / 3 : (Math.sin(theta) - theta * Math.cos(theta)) / (theta * theta);
  const left = duration * half * acceleration * slant, middle = state.heading + theta;
  state.x += along * Math.cos(middle) - left * Math.sin(middle);
  state.y += along * Math.sin(middle) + left * Math.cos(middle);
  state.heading += 2 * theta;
}

// envs/relative.py, leg_separation: the smallest distance in a step, and the fraction of the step at which it is.
function closest(a, aNext, b, bNext, dt) {
  const velocity = (one, other) => [
    other.speed * Math.cos(other.heading) - one.speed * Math.cos(one.heading),
    other.speed * Math.sin(other.heading) - one.speed * Math.sin(one.heading),
  ];
  const [vx0, vy0] = velocity(a, b), [vx1, vy1] = velocity(aNext, bNext);
  const x0 = b.x - a.x, y0 = b.y - a.y, chordX = bNext.x - aNext.x - x0, chordY = bNext.y - aNext.y - y0;
  const bendX = 0.5 * dt * (vx1 - vx0), bendY = 0.5 * dt * (vy1 - vy0);
  const at = (s) => [x0 + s * (chordX + bendX * (s - 1)), y0 + s * (chordY + bendY * (s - 1))];
  let s = clip(-(x0 * chordX + y0 * chordY) / Math.max(chordX ** 2 + chordY ** 2, 1e-12), 0, 1);
  const [x, y] = at(s), dx = chordX + bendX * (2 * s - 1), dy = chordY + bendY * (2 * s - 1);
  const curvature = dx * dx + dy * dy + 2 * (x * bendX + y * bendY);
  s = clip(s - (x * dx + y * dy) / Math.max(curvature, 1e-12), 0, 1);
  return [0, s, 1].map((s) => [Math.hypot(...at(s)), s]).reduce((best, one) => (one[0] < best[0] ? one : best));
}
