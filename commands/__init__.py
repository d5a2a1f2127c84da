"""What every command shares: command line and refusals, files and locks, progress,
figures and YAML.

What the flight path uses of it is the standard library alone (the contract ``flight-path`` in
pyproject.toml lists it).
"""
