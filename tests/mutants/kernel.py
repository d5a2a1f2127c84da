"""Mutants of the kernel, by its modules."""

from tests.mutants.mutant import Mutant, mutants_of

_CLEARANCE = "tests/agents/kernel/test_clearance.py"
_AREAS = "tests/agents/kernel/test_areas.py"
_VALIDATOR = "tests/agents/planner/test_validator.py"
_PROOFS = "tests/agents/test_proofs.py"
_SCALAR = "tests/agents/kernel/test_scalar_separation.py"
_SCALAR_AREAS = "tests/agents/kernel/test_scalar_areas.py"

_OF_TRAJECTORY = (
    # What a curve may leave its chord by.
    ("0.125 * bend.max(axis=-1) * step[..., 0] ** 2", "0.0"),
    ("error = curves.miss + position_error_bound(curves)", "error = position_error_bound(curves)"),
    ("error = curves.miss + position_error_bound(curves)", "error = curves.miss"),
    ("STRAIGHT = 1e-4", "STRAIGHT = 10.0"),
    ("(x * x + y * y).max(axis=-1)", "(x * x).max(axis=-1)"),
    # What is flown.
    ("speed * (time - steers)", "speed * time"),
    ("steering.acceleration * steers", "steering.acceleration * time"),
    ("self.states.time - since[:, None], 0.0", "self.states.time, 0.0"),
    # What has been flown.
    ('"x0": arcs.x0[m, p] + east', '"x0": arcs.x0[m, p]'),
    ('"heading": heading + yaw_rate * past', '"heading": heading'),
    ("legs=self.legs._replace(time=self.legs.time - shift)", "legs=self.legs"),
    # Parts.
    ("x1=x[:, 1:]", "x1=x[:, :-1]"),
    ("end=time[:, 1:]", "end=time[:, :-1]"),
)

_OF_ARCS = (
    ("distance(acceleration, quickest(", "distance(0.0 * acceleration, quickest("),
    ("speed, acceleration, lasts, xp) * yaw_rate, xp)", "speed, acceleration, lasts, xp), xp)"),
    ("xp.maximum(speed, speed + acceleration * lasts)", "speed"),
    ("* (square * square * square * turn)", ""),
    # Of the compiled loop.
    ("math.sqrt(far) + 0.125 * most * step**2", "math.sqrt(far)"),
    ("curves.miss[row, leg] + (sum_of", "(sum_of"),
)

_OF_CLEARANCE = (
    ("CLOSE = 1e-3", "CLOSE = 1e-1"),
    ("ROUNDING = 1e-6", "ROUNDING = 1e-2"),
    ("unclear &= ~bounds.exact", "unclear &= bounds.exact"),
    (
        "decided = decided | (bounds.margin >= levels",
        "decided = decided | (bounds.margin <= levels",
    ),
    ("np.maximum.at(flat.until, owner[m], ends)", "np.minimum.at(flat.until, owner[m], ends)"),
    (
        "nearer = distance[m, p] < flat.distance[row]",
        "nearer = distance[m, p] > flat.distance[row]",
    ),
    ("lost_from[m_first, p_first] < flat.loss", "lost_from[m_first, p_first] > flat.loss"),
    ("lost = ~(margin >= 0.0)", "lost = margin < -1.0"),
)

_OF_SEPARATION = (
    # What is left out.
    ("+ 0.125 * turn * (end - begin) ** 2", ""),
    ("(flown.sagitta + flown.error)[..., None]", "0.0"),
    ("near |= (bound <= attained) | (margin <= least)", "near |= margin <= least"),
    ("near |= (bound <= attained) | (margin <= least)", "near |= bound <= attained"),
    ("counts = wide.mask & (end > 0.0)", "counts = (end > 0.0)"),
    # What is required.
    ("middle, pieces.end))", "middle, middle))"),
    ("tolerated = np.maximum(required - CLOSE, ", "tolerated = np.minimum(required - CLOSE, "),
    ("counts = (pieces.end > 0.0) & within_window", "counts = within_window"),
    (
        "begin, end = (\n                distances[places] + ",
        "begin, end = (\n                distances[places] - ",
    ),
)

_OF_CHORDS = (
    ("SECANT = 0.02", "SECANT = 1e3"),
    ("return away - (begin + share * grows)", "return away - begin"),
    ("xp.where(faster, nearest + after, 1.0)", "xp.where(faster, nearest, 1.0)"),
    ("xp.where(c < 0.0, 0.0, c /", "xp.where(c < 0.0, 1.0, c /"),
    ("acceleration * (0.125 * lasts**2)", "acceleration * (0.0125 * lasts**2)"),
    ("largest_sagitta(pieces.bend + turn,", "largest_sagitta(pieces.bend,"),
    ("largest_sagitta(pieces.bend + turn,", "largest_sagitta(turn,"),
    ("near - loss - error", "near - error"),
    ("near - loss - error", "near - loss"),
)

# The numpy version is the reference: a fault of the compiled one shows beside it.
_OF_SCALAR_SEPARATION = (
    ("+ turned + BOUND_ERROR", "+ BOUND_ERROR"),
    ("bound[k, leg] <= attained or ", ""),
    (" or margin[k, leg] <= least", ""),
    ("near[k, leg] = end > 0.0 and", "near[k, leg] ="),
    ("elif time < intruder.turn_time:", "elif time < 0.0:"),
    ("keeping.least[row, k] - ROUNDING", "keeping.least[row, k] - 1.0"),
    ("max(required - intruder.tolerance, intruder.least)", "required - intruder.tolerance"),
    ("counts = piece.end > 0.0 and", "counts ="),
    ("at_first + piece.error_begin + line.sagitta", "at_first + line.sagitta"),
)

_OF_SCALAR_CLEARANCE = (
    ("not closest and bounds.margin >= judged.level", "bounds.margin >= judged.level"),
    ("and not bounds.distance <= nearest", ""),
    ("decides or lost, True", "decides, True"),
    ("margin < clearance.margin or", "margin > clearance.margin or"),
    ("lost_from < clearance.loss", "lost_from > clearance.loss"),
    ("max(clearance.until, bounds.lost_until)", "bounds.lost_until"),
)

_OF_SCALAR_AREAS = (
    ("near[leg] or not far > judged.level", "near[leg] or not far > judged.level + 1e3"),
    ("area.sign > 0.0 and away > 0.0", "area.sign > 0.0"),
    ("away + _least_gain(area, piece) - _chord_error(piece)", "away + _least_gain(area, piece)"),
    ("piece.end > 0.0 and piece.end >= area.begin", "piece.end >= area.begin"),
    ("piece.begin >= area.begin and piece.end <= area.end", "piece.end <= area.end"),
    ("max(required - CLOSE, -ROUNDING)", "required - CLOSE"),
    ("min(area.gain * piece.begin,", "max(area.gain * piece.begin,"),
    ("parts.ready[:] = False", "pass"),
)

_OF_SCALAR_PIECES = (
    ("arc.bend = flown.bend[row, leg, number]", "arc.bend = 0.0"),
    ("piece.heading += piece.yaw_rate * past", "pass"),
    ("piece.error_begin = piece.error\n", "pass\n"),
    ("x[i] * (i * part)", "x[i]"),
)

_OF_AREAS = (
    ("NEARER = 0.01", "NEARER = 1.0"),
    ("counts & ~(far > required)", "counts & ~(far > -required)"),
    ("return chord.bound + grown - lost,", "return chord.bound + grown,"),
    ("return chord.bound + grown - lost,", "return chord.bound - lost,"),
    ("np.maximum(required - CLOSE, -ROUNDING)", "required - 100.0"),
    ("0.125 * pieces.bend * (pieces.end - pieces.begin) ** 2 + pieces.error", "pieces.error"),
    ("(pieces.end >= active.begin) & (pieces.begin <= active.end)", "(pieces.end >= active.begin)"),
    ("away + _least_gain(area, pieces) - _chord_error(pieces)", "away + _least_gain(area, pieces)"),
    ("np.where(away > 0.0, away, -np.inf)", "away"),
    ("np.minimum(gain(area) * pieces.begin,", "np.maximum(gain(area) * pieces.begin,"),
)

_OF_TRAFFIC = (
    ("straight = state.speed * (time - turning)", "straight = state.speed * time"),
    ("np.maximum(separation, np.minimum(usual, away))", "np.minimum(usual, away)"),
    ("np.maximum(separation, np.minimum(usual, away))", "np.maximum(separation, usual)"),
    ("away = np.where(traffic.window.begin > 0.0, np.inf, away)", "pass"),
    ("(end >= window.begin - WINDOW_EDGE)", "(end >= window.begin + 1.0)"),
    ("drift = traffic.velocity_std * (traffic.age + time)", "drift = traffic.velocity_std * time"),
    ("turn_time=turn_time, age=np.abs(age))", "turn_time=turn_time, age=age)"),
)

_CHANGES = {
    "trajectory": (_OF_TRAJECTORY, (_CLEARANCE, _VALIDATOR, _PROOFS)),
    "arcs": (_OF_ARCS, (_SCALAR, _CLEARANCE, _VALIDATOR, _PROOFS)),
    "clearance": (_OF_CLEARANCE, (_CLEARANCE, _AREAS, _VALIDATOR, _PROOFS)),
    "separation": (_OF_SEPARATION, (_CLEARANCE, _VALIDATOR, _PROOFS)),
    "chords": (_OF_CHORDS, (_CLEARANCE, _VALIDATOR, _PROOFS)),
    "scalar_clearance": (_OF_SCALAR_CLEARANCE, (_SCALAR, _SCALAR_AREAS)),
    "scalar_separation": (_OF_SCALAR_SEPARATION, (_SCALAR,)),
    "scalar_areas": (_OF_SCALAR_AREAS, (_SCALAR_AREAS,)),
    "scalar_pieces": (_OF_SCALAR_PIECES, (_SCALAR,)),
    "areas": (_OF_AREAS, (_AREAS, _PROOFS)),
    "traffic": (
        _OF_TRAFFIC,
        (
            _CLEARANCE,
            _VALIDATOR,
            _PROOFS,
            "tests/agents/kernel/test_traffic.py",
            "tests/agents/planner/test_levels.py",
        ),
    ),
}

MUTANTS: tuple[Mutant, ...] = tuple(
    mutant
    for module, (changes, tests) in _CHANGES.items()
    for mutant in mutants_of(f"agents/kernel/{module}.py", changes, tests)
)
