"""Writes the page of every key of an evaluation: ``python -m eval.reference DIR``."""

from envs.edge.command import run_cli

PAGE = "configuration-evaluation.md"
"""Name of the file."""

_HEAD = """\
# Configuration of evaluations

This page is written by `python -m eval.reference docs/reference`; its texts are the docstrings in `eval/config.py`,
`eval/hifi/config.py` and `agents/config/world.py`.

A configuration is a YAML file with what differs from the defaults, given as `--config FILE`; single keys are changed by
`--set KEY=VALUE` (`--set planner.margin=50`), which wins over the file, as do the options of the command. A run writes
what came out, every key, to `config.yaml` in its directory, and that file repeats the run. A key that does not exist, a
value of another type or out of range, and a file that is not there end the program with one sentence and exit status 2,
before anything is flown.

`changes` takes the numbers of a scenario, such as `--set changes.own_speed=[60,70]`: those of `scenarios.0` in
[configuration.md](configuration.md) for sampled scenarios, and those in the last table for `lincoln:PATH`.

"""


def page() -> str:
    """Return the text of the page."""
    from agents.config.keys import markdown
    from eval.config import MonteCarloConfig, TrafficConfig
    from eval.hifi.config import HifiConfig

    parts = [
        f"## `python -m eval.monte_carlo`\n\n{markdown(MonteCarloConfig)}",
        f"## `python -m eval.hifi`\n\nAll keys above have the same meaning here, but for `mode`. Also:\n\n"
        f"{markdown(HifiConfig, beside=MonteCarloConfig)}",
        f"## `changes` of `lincoln:PATH`\n\n{markdown(TrafficConfig)}",
    ]
    return _HEAD + "\n".join(parts)


def main() -> None:
    """Write the page into the directory that the command line names."""
    from agents.config.pages import write_pages

    write_pages("python -m eval.reference", __doc__, {PAGE: page()})


if __name__ == "__main__":
    run_cli("eval.reference:main")
