"""Mutants of what decides what the monitor says, by its modules."""

from tests.mutants.mutant import Mutant, mutants_of

_FOLDER = "tests/agents/assurance"
_MONITOR = f"{_FOLDER}/test_monitor.py"
_INPUTS = f"{_FOLDER}/test_inputs.py"
_AREAS = f"{_FOLDER}/test_areas.py"
_BACKUP = f"{_FOLDER}/test_backup.py"
_FRAMES = f"{_FOLDER}/test_frames.py"
_CONFORMANCE = f"{_FOLDER}/test_conformance.py"
_CLIMBS = f"{_FOLDER}/test_climbs.py"
_BACKUP_HEIGHTS = f"{_FOLDER}/test_backup_heights.py"
_OUTSIDE = "tests/eval/evidence/test_outside.py"

_OF_MONITOR = (
    # What is not safe is not flown, and says so.
    ("state=int(State.DENIED), on_backup=True, causes", "state=int(State.DENIED), causes"),
    ("causes |= np.where(~idle & ~backup.safe, int(Cause.BACKUP_UNSAFE), 0)", "pass"),
    ("causes |= np.where(~idle & (backup.depth > 0.0), int(Cause.BACKUP_IN_AREA), 0)", "pass"),
    ("causes |= np.where(requests.refused, int(Cause.REFUSED), 0)", "pass"),
    ("causes |= np.where(requests.silent, int(Cause.NO_ANSWER), 0)", "pass"),
    ("causes & int(BLIND | LOST), causes)", "causes, causes)"),
    # When the backup is flown, and when it is left.
    ("urgent = measured.loss <= thresholds.urgent", "urgent = measured.loss > thresholds.urgent"),
    ("(requests.hopeless | (requests.held_up & urgent))", "requests.hopeless"),
    ("(requests.hopeless | (requests.held_up & urgent))", "(requests.held_up & urgent)"),
    ("(requests.hopeless | (requests.held_up & urgent))", "(requests.hopeless | requests.held_up)"),
    ("has(causes, UNSAFE) & (requests", "(requests"),
    ("ended = time - monitor.started >= monitor.plan.end", "ended = time < 0.0"),
    ("(monitor.on_backup | ((at_once | ended) & ~blind)) & ~idle", "(at_once | ended) & ~blind"),
    ("((at_once | ended) & ~blind)", "(at_once | ended)"),
    # When a plan is asked for.
    ("request_traffic=take(traffic, asking), requested_at", "requested_at"),
    ("unmet = has(causes, WANTING) | monitor.on_backup", "unmet = monitor.on_backup"),
    ("WANTING) | monitor.on_backup | blind", "WANTING) | blind"),
    ("monitor.on_backup | blind\n", "monitor.on_backup\n"),
    ("has(monitor.causes, Cause.REFUSED) & unmet", "has(monitor.causes, Cause.REFUSED)"),
    (">= thresholds.replan_interval - 1e-9", ">= thresholds.replan_interval - 1.0"),
    ("rested & (~pending | silent)", "rested & ~pending"),
    ("| silent) & ~blind & ~lost", "| silent) & ~lost"),
    ("~blind & ~lost & ~idle", "~blind & ~idle"),
    ("(pending & ~may_ask) | ~rested | silent", "(pending & ~may_ask) | silent"),
    ("hopeless=refused | lost | silent", "hopeless=refused | silent"),
    ("sighted = np.flatnonzero(~(idle | blind))", "sighted = np.flatnonzero(~idle)"),
    # Which state wins.
    ("has(causes, LOST) | (wants & unanswered)", "has(causes, LOST)"),
    ("unanswered=requests.refused | requests.silent", "unanswered=requests.refused"),
    (
        "has(causes, BLIND), on_backup, denied, wants],\n        [State.IDLE, State.DENIED, State.BACKUP,",
        "on_backup, has(causes, BLIND), denied, wants],\n        [State.IDLE, State.BACKUP, State.DENIED,",
    ),
    # Which answers are taken up.
    ("(number == monitor.requested[rows])", "(number <= monitor.requested[rows])"),
    ("& (monitor.answered[rows] < number)", ""),
    ("np.asarray(safe) & current & ~blind", "np.asarray(safe) & current"),
    ("        - thresholds.resolution\n", "        + 10.0\n"),
    ("(clearances.margin >= 0.0).all(axis=-1) & ~from_areas.lost", "~from_areas.lost"),
    (
        "(clearances.margin >= 0.0).all(axis=-1) & ~from_areas.lost",
        "(clearances.margin >= 0.0).all(axis=-1)",
    ),
    ("causes=result.causes[refused] | int(Cause.REFUSED)", "causes=result.causes[refused]"),
    ("seeing = rows[current & ~accepted & ~blind]", "seeing = rows[current & ~accepted]"),
    ("result.on_backup[seeing] | has(result.causes[seeing], UNSAFE)", "result.on_backup[seeing]"),
    (
        "on_backup = result.on_backup[seeing] | has(result",
        "on_backup = has(result",
    ),
    (
        "rows[\n        validate(take(plan_states, rows), nobody, thresholds.requirement, "
        "thresholds.limits).safe\n    ]",
        "rows",
    ),
    ('"expected": expected, "sums": 0.0}', '"expected": expected}'),
)

_OF_CONFORMANCE = (
    ("required_separation - thresholds.separation_band", "required_separation"),
    (
        "np.maximum(\n        separations(traffic, thresholds.requirement),\n",
        "np.minimum(\n        separations(traffic, thresholds.requirement),\n",
    ),
    ("self.leave * limit", "limit"),
    # What is measured against the plan.
    ("~has(causes, BLIND), latch", "has(causes, BLIND) | True, latch"),
    ("thresholds.plan_ending - remaining, 0.0", "-remaining, 0.0"),
    ("np.hypot(off.cross_track, off.along_track)", "np.abs(off.cross_track)"),
    ("np.where(concern, deviations.share_of(thresholds), 0.0)", "deviations.share_of(thresholds)"),
    ("np.where(follows_plan(monitor), -1, ~int(WANTING & ~_REPORTS))", "np.full(since.shape, -1)"),
    ("~int(WANTING & ~_REPORTS)", "~int(WANTING)"),
    (
        "np.min(separation, axis=-1, initial=np.inf) - offset",
        "np.min(separation, axis=-1, initial=np.inf)",
    ),
    ("loss=np.minimum(loss, from_areas.loss)", "loss=loss"),
    ("loss=np.minimum(loss, from_areas.loss)", "loss=from_areas.loss"),
    ("since, areas, offset, thresholds)", "since, areas, 0.0 * offset, thresholds)"),
    # Errors that last.
    ("(sighted & finite)[:, None]", "finite[:, None]"),
    ("before * np.exp(-seconds / thresholds.memory)", "before"),
    ("thresholds.sustained * thresholds.memory * limits", "thresholds.memory * limits"),
    ("elapsed = memory.time - monitor.memory.time", "elapsed = 0.0 * memory.time + 1.0"),
    # The rest of the plan.
    ("separation < thresholds.concern + more", "separation < thresholds.concern"),
    ("np.minimum(planned, requirement_of(traffic, own, requirement))", "planned"),
    (
        "np.minimum(planned, requirement_of(traffic, own, requirement))",
        "requirement_of(traffic, own, requirement)",
    ),
    (
        "least + thresholds.separation_band, least - thresholds.resolution",
        "least - thresholds.resolution, least - thresholds.resolution",
    ),
    ("- thresholds.resolution + off)", "- thresholds.resolution)"),
    ("np.where(follows_plan(monitor)[:, None], 0.0, -np.inf)", "np.full(off.shape, -np.inf)"),
    ("monitor.plan.since(since), Separation", "monitor.plan, Separation"),
    # Intruders that fly otherwise.
    ("np.maximum(self.position / place, self.velocity / motion)", "self.velocity / motion"),
    ("np.maximum(self.position / place, self.velocity / motion)", "self.position / place"),
    ("_NOISE = 3.0", "_NOISE = 0.0"),
    ("np.where(new, np.inf, error)", "np.where(new, 0.0, error)"),
    (
        "np.hypot(uncertainty(expected, since[:, None]), uncertainty(traffic, 0.0))",
        "uncertainty(traffic, 0.0)",
    ),
    (
        "np.hypot(uncertainty(expected, since[:, None]), uncertainty(traffic, 0.0))",
        "uncertainty(expected, since[:, None])",
    ),
    ("np.hypot(expected.velocity_std, traffic.velocity_std)", "expected.velocity_std"),
    ("np.hypot(expected.velocity_std, traffic.velocity_std)", "traffic.velocity_std"),
    # Plans that climb.
    ("areas = memory.areas if met is None else met.areas", "areas = memory.areas"),
    ("reshape(by_time).any(axis=-1)", "reshape(by_time).all(axis=-1)"),
    (
        "latch.bits(np.abs(error), allowed, Cause.ALTITUDE_ERROR)",
        "latch.bits(error, allowed, Cause.ALTITUDE_ERROR)",
    ),
)

_OF_PROFILES = (("    if faults:\n", "    if not faults and faults:\n"),)
_OF_CLIMBS = (
    ("spread.mask & (begin <= end)", "spread.mask"),
    ("max(options.vertical_margin, error)", "options.vertical_margin"),
    ("max(options.vertical_margin, error)", "error"),
    ("if own is None or own.reference != self.reference:", "if own is None:"),
    ("if not options.climbs:", "if False:"),
    ("if level is not None and level.reference != own.reference:", "if False:"),
    ("options).since(-time), own.reference)", "options), own.reference)"),
)

_OF_BACKUP_HEIGHTS = (
    ("error=own.error + farther", "error=own.error"),
    (
        "replace(own, error=own.error + farther), options.vertical_margin",
        "replace(own, error=own.error + farther), 0.0",
    ),
    ("if limit is not None and limit.reference != own.reference:", "if False:"),
    ("if corner > ends[0]:", "if False:"),
    ("if not profile_faults(profile, own, options):", "if True:"),
    (
        "return min(max(climb_of(sense, options), climb - most), climb + most)",
        "return climb_of(sense, options)",
    ),
    ("[sense is Sense.LEVEL_OFF or bool(flight) for flight in flights]", "[True for _ in flights]"),
    ("options.ceiling if sense is Sense.CLIMB else options.floor", "options.ceiling"),
)

_OF_BACKUP = (
    ("ends = levelled.safe | ~meets.possible", "ends = levelled.safe"),
    ("ends = levelled.safe | ~meets.possible", "ends = ~meets.possible"),
    ("meets.possible & fits", "meets.possible"),
    (" & (thresholds.manoeuvre.speed_min <= fastest)", ""),
    ("unsafe = np.flatnonzero(~result.safe)", "unsafe = np.arange(result.safe.size)"),
    ("clearance = np.fmax(clearance, lost_in_height[:, None, :, step + sample - 1])", "pass"),
)

_OF_INPUTS = (
    # Which reports count.
    ("(inputs.time > memory.time)", "(inputs.time >= memory.time)"),
    ("good = sane & ordered & clock\n", "good = sane & ordered\n"),
    ("good = sane & ordered & clock\n", "good = sane & clock\n"),
    ("        & _spread(inputs.position_std)\n", ""),
    ("        & _spread(inputs.velocity_std)\n", ""),
    ("np.where(inputs.mask, memory.reported, -np.inf)", "memory.reported"),
    (
        "good = sane & ordered & clock[:, None] & inputs.mask",
        "good = sane & clock[:, None] & inputs.mask",
    ),
    ("good = sane & ordered & clock[:, None] & inputs.mask", "good = sane & ordered & inputs.mask"),
    # What lies in them.
    ("outside = speed > _SIGMAS * memory.velocity_std", "outside = speed > np.inf"),
    ("outside |= turn > thresholds.turn_rate_min + _SIGMAS * memory.turn_std", "pass"),
    ('outside |= excess(thresholds.traffic["position_std"], memory.position_std) > 0.0', "pass"),
    ('outside |= excess(thresholds.traffic["velocity_std"], memory.velocity_std) > 0.0', "pass"),
    (
        "~(time - memory.reported <= thresholds.intruder_age)",
        "time - memory.reported > thresholds.intruder_age + 1.0",
    ),
    ("velocity_std=np.hypot(memory.velocity_std, turned)", "velocity_std=memory.velocity_std"),
    # What is believed of reports.
    (
        "missing = beliefs.doubtful | ~np.isfinite(sightings.time)",
        "missing = ~np.isfinite(sightings.time)",
    ),
    ("age=np.where(missing, 0.0, time - sightings.time)", "age=np.zeros(np.shape(missing))"),
)


_OF_TRACKER = (
    ("xp.clip(turn_rate, -most, most), 0.0)", "turn_rate, 0.0)"),
    ("xp.abs(turn_rate) >= least", "xp.abs(turn_rate) >= 0.0"),
)

_OF_FRAMES = (
    ("intruders=state(memory.intruders, memory.reported)", "intruders=memory.intruders"),
    ("areas=_areas(memory, old, new)", "areas=memory.areas"),
    ("expected=traffic(monitor.expected, monitor.started)", "expected=monitor.expected"),
    (
        "request_traffic=traffic(monitor.request_traffic, monitor.requested_at)",
        "request_traffic=monitor.request_traffic",
    ),
    ("turned_error(turn, new.wind.std - old.wind.std)", "0.0 * turn"),
    ("(old_traffic.turn_time + old_traffic.age)", "old_traffic.turn_time"),
    (
        "carried = new.to_air(old.to_ground(old_state, time), time)",
        "carried = new.to_air(old.to_ground(old_state, 0.0 * time), 0.0 * time)",
    ),
    (
        "state = self.to_air(report.state, time - report.age)",
        "state = self.to_air(report.state, time)",
    ),
)

_OF_STATE = (
    ("if before >= 0]\n", "if before > 0]\n"),
    ("expected=map_leaves(move, fresh.expected, monitor.expected)", "expected=fresh.expected"),
    (
        "request_traffic=map_leaves(move, fresh.request_traffic, monitor.request_traffic)",
        "request_traffic=fresh.request_traffic",
    ),
)

_OF_SPACE = (
    (
        "if not abs(own.value - height.altitude) <= options.vertical_margin:",
        "if not abs(own.value - height.altitude) <= 2.0 * options.vertical_margin:",
    ),
    ("begin = self.begin_backup(own)", "begin = own"),
    ("value=height.altitude, vertical_speed=height.climb", "value=height.altitude"),
    ("or own.reference != self.flown.reference", ""),
)

_OF_SINGLE = (
    ("self.backup_climb if self.monitor.on_backup[0] else self.climb", "self.climb"),
    (
        "climb_of_backup(sense, begin, time, from_begin)",
        "climb_of_backup(sense, own_altitude, time, from_begin)",
    ),
)


_CHANGES = {
    "agents/assurance/monitor.py": (
        _OF_MONITOR,
        (_CONFORMANCE, _MONITOR, _INPUTS, _AREAS, _OUTSIDE),
    ),
    "agents/assurance/conformance.py": (
        _OF_CONFORMANCE,
        (_CONFORMANCE, _AREAS, _BACKUP, _MONITOR, _CLIMBS),
    ),
    "agents/assurance/climbs.py": (_OF_CLIMBS, (_CLIMBS,)),
    "agents/assurance/space.py": (_OF_SPACE, (_CLIMBS,)),
    "agents/assurance/single.py": (_OF_SINGLE, (_CLIMBS,)),
    "agents/assurance/backup.py": (_OF_BACKUP, (_BACKUP, _BACKUP_HEIGHTS)),
    "agents/assurance/backup_heights.py": (_OF_BACKUP_HEIGHTS, (_BACKUP_HEIGHTS, _CLIMBS)),
    "agents/planner/judge/profile.py": (_OF_PROFILES, (_CLIMBS,)),
    "agents/assurance/inputs.py": (_OF_INPUTS, (_INPUTS, _FRAMES, _OUTSIDE)),
    "envs/tracking/tracker.py": (_OF_TRACKER, (_INPUTS,)),
    "agents/assurance/frames.py": (_OF_FRAMES, (_FRAMES, _AREAS)),
    "agents/assurance/state.py": (_OF_STATE, (_FRAMES,)),
}

MUTANTS: tuple[Mutant, ...] = tuple(
    mutant
    for file, (changes, tests) in _CHANGES.items()
    for mutant in mutants_of(file, changes, tests)
)
