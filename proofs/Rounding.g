# Rounding of the validator's formulas (agents/kernel/chords.py, agents/kernel/traffic.py) in double precision, bounded by Gappa.
# Domain: coordinates up to 2^20 m, speeds up to 400 m/s, times up to 2^14 s, turns up to 32 rad, so that relative
# positions stay below 2^24 m. Beyond it the certificate decides (agents/check).
# Together they are below 0.3 micrometres: docs/explanation/safe-theorem.md.

@rnd = float<ieee_64, ne>;

# An intruder's coordinate; c is the cosine or sine as computed, C the true one: the angle is rounded below 32 rad.
place rnd= x + v * c * t;
Place = x + v * C * t;

# A coordinate of the chord's point that is taken for the nearest.
node rnd= x0 + s * dx;
Node = x0 + s * dx;

# A distance.
px = rnd(px_);
py = rnd(py_);
far rnd= sqrt(px * px + py * py);
Far = sqrt(px * px + py * py);

# What the sagitta takes; r is 4 sagitta less the opening.
sagitta = rnd(sagitta_);
r = rnd(r_);
loss rnd= r * r / (16 * sagitta);
Loss = r * r / (16 * sagitta);

{ |x| <= 1b20 /\ v in [0, 400] /\ t in [0, 1b14] /\ |C| <= 1 /\ |c - C| <= 1b-47
  /\ |x0| <= 1b24 /\ |dx| <= 1b24 /\ s in [0, 1]
  /\ |px| in [1b-100, 1b24] /\ |py| in [1b-100, 1b24]
  /\ sagitta in [1e-12, 1b24] /\ |r| in [1b-100, 1b24]
  -> |place - Place| <= 1b-24 /\ |node - Node| <= 1b-28 /\ |far -/ Far| <= 1b-51 /\ |loss -/ Loss| <= 1b-51 }
