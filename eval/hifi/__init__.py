"""Plans flown by a Cessna 208B in JSBSim: ``python -m eval.hifi``."""
