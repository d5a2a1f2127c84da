"""Writes the pages of the documentation that come from the code: ``python -m rlcas_jax.reference DIR``."""

from envs.edge.command import run_cli
from rlcas_jax.metrics import FILE, METRICS, WALL_CLOCK

_CONFIGURATION = """\
# Configuration of training

This page is written by `python -m rlcas_jax.reference docs/reference`; its texts are the docstrings in
`rlcas_jax/config.py` and `agents/config/world.py`.

A configuration is a YAML file with what differs from the defaults, given as `--config FILE`; single keys are changed by
`--set KEY=VALUE`, also inside lists (`--set scenarios.0.weight=2`). `--set` wins over the file. A run writes what came
out, every key, to `config.yaml` in its directory, and that file repeats the run.

The files in `configs/` are `quick.yaml` (a policy in a minute on two cores), `best.yaml` (the policy that ships),
`paper.yaml` (the paper's own set-up), `sprint.yaml` (seconds to a training score of +75) and the aircraft in
`configs/aircraft/`: `paper.yaml` (the default), `c208.yaml`, `uas.yaml`, `light.yaml` and `jet.yaml`.

Numbers may be written as `3e-4`, `1e7` and `1_000_000`. A key that does not exist, a value of another type or out of
range, a key that stands twice and a file that is not there end the program with one sentence and exit status 2, before
anything else happens.

"""

_METRICS = f"""\
# Metrics of training

This page is written by `python -m rlcas_jax.reference docs/reference`; its texts stand in `rlcas_jax/metrics.py`.

A run appends one JSON object an update to `{FILE}` in its directory (`null` where a figure is not known, such as the
score of an update in which no episode ended), and the same to `tensorboard/` where tensorboardX is installed.
`rlcas_jax.metrics.read(DIR)` returns them as arrays. Figures of an evaluation stand in the line of the update after
which it was made. Two runs of one configuration on the same kind of machine and the same versions differ in
{" and ".join(f"`{name}`" for name in WALL_CLOCK)} only, resumed or not.

| metric | meaning |
|---|---|
"""


def pages() -> dict[str, str]:
    """Return the generated pages by the name of their file."""
    from agents.config.keys import markdown
    from rlcas_jax.config import TrainConfig

    rows = "".join(f"| `{name}` | {text} |\n" for name, text in METRICS.items())
    return {"configuration.md": _CONFIGURATION + markdown(TrainConfig), "metrics.md": _METRICS + rows}


def main() -> None:
    """Write the pages into the directory that the command line names.

    Raises:
        ConfigError: there is no such directory.
    """
    from agents.config.pages import write_pages

    write_pages("python -m rlcas_jax.reference", __doc__, pages())


if __name__ == "__main__":
    run_cli("rlcas_jax.reference:main")
