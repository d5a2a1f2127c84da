"""The training program as its user meets it: options, lines of progress, and interruption."""

import io
import math
import signal
import subprocess
import sys
import time
from datetime import UTC, datetime
from pathlib import Path

import pytest

from agents.config.keys import keys
from agents.config.load import ConfigError, load
from commands.progress import Progress, duration
from rlcas_jax import metrics
from rlcas_jax.cli import Options, parse, write_configurations
from rlcas_jax.config import TrainConfig
from rlcas_jax.progress import Reporter
from rlcas_jax.train import main

ROOT = Path(__file__).resolve().parents[2]
MOMENT = datetime(2026, 1, 31, 12, 0, 0, tzinfo=UTC)


def write_jobs(options: Options) -> None:
    for job in options.jobs:
        job.directory.mkdir(parents=True, exist_ok=True)
    write_configurations(options)


def test_a_change_of_the_defaults_is_trained_in_a_folder_with_the_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    options = parse(["--set", "seed=0"], moment=MOMENT)
    assert options.directory == Path("runs/train-20260131T120000-0")
    (job,) = options.jobs
    assert (job.config, job.directory, job.resume) == (TrainConfig(), options.directory, False)
    assert not options.quiet
    assert not list(tmp_path.iterdir())


def test_arguments_reach_the_configuration(tmp_path: Path):
    file = tmp_path / "a.yaml"
    file.write_text("name: a\nsteps: 7\n")
    argv = [
        "--config",
        str(file),
        "--set",
        "seed=5",
        "--set",
        "ppo.clip=0.3",
        "--steps",
        "1e6",
        "--quiet",
    ]
    options = parse([*argv, "--out", str(tmp_path / "out")])
    config = options.jobs[0].config
    assert (config.name, config.seed, config.ppo.clip, config.steps) == ("a", 5, 0.3, 1_000_000)
    assert options.quiet


def test_several_seeds_are_several_runs(tmp_path: Path):
    options = parse(["--set", "seed=4", "--seeds", "3", "--out", str(tmp_path / "out")])
    assert [job.config.seed for job in options.jobs] == [4, 5, 6]
    assert [job.directory.name for job in options.jobs] == ["seed-0", "seed-1", "seed-2"]
    write_jobs(options)
    assert load(TrainConfig, tmp_path / "out" / "seed-2" / "config.yaml").seed == 6


@pytest.mark.parametrize("seeds", [1, 11])
def test_a_resumed_run_is_the_prepared_one(tmp_path: Path, seeds: int):
    out = tmp_path / "out"
    fresh = parse(["--set", "ppo.clip=0.3", "--seeds", str(seeds), "--out", str(out)])
    write_jobs(fresh)
    checkpoints = fresh.jobs[0].directory / "checkpoints"
    checkpoints.mkdir()
    (checkpoints / "checkpoint-0000000003.safetensors").touch()
    resumed = parse(["--resume", str(out), "--quiet"])
    write_jobs(resumed)
    assert [job.config for job in resumed.jobs] == [job.config for job in fresh.jobs]
    assert [job.directory for job in resumed.jobs] == [job.directory for job in fresh.jobs]
    # What was not begun yet begins.
    assert [job.resume for job in resumed.jobs] == [True] + [False] * (seeds - 1)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--config", "none.yaml"], "none.yaml: there is no such file"),
        (
            ["--set", "ppo.clipp=1"],
            "--set: ppo.clipp is unknown (its value is 1); did you mean ppo.clip?",
        ),
        (
            ["--steps", "1.5"],
            "--set: steps is 1.5; expected a whole number at least 1 and at most 1e+12",
        ),
        (
            ["--set", "seed=0", "--seeds", "0"],
            "argument --seeds: '0'; expected a whole number of at least 1 (see python -m rlcas_jax.train "
            "--help)",
        ),
        (
            ["--set", "seed=2147483647", "--seeds", "2"],
            "--seeds is 2; expected 1 to 1 (seeds are below 2147483648)",
        ),
        (
            ["--seeds", "x"],
            "argument --seeds: 'x'; expected a whole number of at least 1 (see python -m rlcas_jax.train "
            "--help)",
        ),
        (["--resume", "none"], "--resume none: there is no such directory"),
        (["--resume", "."], "--resume .: it holds no config.yaml, so it is no run"),
        (
            ["--resume", ".", "--steps", "3"],
            "--steps cannot change a run that is resumed; leave it out, or start a new run "
            "without --resume",
        ),
        (
            [],
            "--config is missing; expected a YAML file, or one that ships: best, paper, quick, "
            "sprint",
        ),
        (
            ["--conf", "x"],
            "unrecognized arguments: --conf x (see python -m rlcas_jax.train --help)",
        ),
    ],
)
def test_bad_arguments_are_refused_in_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], sentence: str
):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigError) as caught:
        parse(arguments)
    assert str(caught.value) == sentence


def test_a_directory_in_use_is_not_overwritten(tmp_path: Path):
    (tmp_path / "file").touch()
    for out in (tmp_path, tmp_path / "file"):
        with pytest.raises(
            ConfigError, match="exists and is not empty; name another, or go on with it by --resume"
        ):
            parse(["--config", "quick", "--out", str(out)])
    (tmp_path / "empty").mkdir()
    options = parse(["--config", "quick", "--out", str(tmp_path / "empty")])
    assert options.directory == tmp_path / "empty"


def test_a_key_that_the_phases_set_themselves_is_refused(tmp_path: Path):
    phases = "phases=[{steps: 100, ppo: {epochs: 1}}, {steps: 200}]"
    for given, key in (("steps=7", "steps"), ("ppo.epochs=2", "ppo.epochs")):
        with pytest.raises(
            ConfigError, match=rf"{key} is set by phase 0 itself; expected phases\.0\.{key}"
        ):
            parse(["--set", phases, "--set", given, "--out", str(tmp_path / "out")])
    options = parse(["--set", phases, "--set", "phases.1.steps=7", "--out", str(tmp_path / "out")])
    assert [phase.steps for phase in options.jobs[0].config.phase_configs()] == [100, 7]


def test_help_lists_every_key_and_loads_nothing_heavy():
    program = (
        "import sys\n"
        "from rlcas_jax.cli import parse\n"
        "try: parse(['--help'])\n"
        "except SystemExit as end: assert end.code == 0\n"
        "heavy = {'jax', 'flax', 'optax', 'matplotlib', 'rich', 'tensorboardX', 'scipy'} & "
        "set(sys.modules)\n"
        "assert not heavy, heavy\n"
    )
    result = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stderr
    for key in keys(TrainConfig):
        assert f"\n  {key.name}: " in result.stdout
    for option in ("--config", "--set", "--resume", "--out", "--seeds", "--steps", "--quiet"):
        assert option in result.stdout


# Ctrl-C and SIGTERM: answered at once, whatever runs, and never a crash.

TINY = """\
steps: 2_000_000_000
network: {hidden: [8]}
environments: 16
rollout: 16
ppo: {minibatch: 64, segment: 8, epochs: 1}
pool_rows: 2
evaluation: {final_encounters: 16}
checkpoint: {every_seconds: 0.0}
"""
BUSY = """
import hashlib, sys
from rlcas_jax.interrupt import Interrupt
with Interrupt() as interrupt:
    interrupt.waits_for("the call" if sys.argv[1] == "work" else None)
    print("busy", flush=True)
    hashlib.pbkdf2_hmac("sha256", b"", b"", 100_000_000)  # a long call, as that of a compiler
"""


def start_process(*arguments: object) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [sys.executable, *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        cwd=ROOT,
    )


def busy(*arguments: str) -> "subprocess.Popen[str]":
    process = start_process("-c", BUSY, *arguments)
    assert process.stdout is not None
    assert process.stdout.readline() == "busy\n"
    return process


def test_the_first_signal_says_what_it_waits_for_and_the_second_ends() -> None:
    process = busy("work")
    assert process.stdout is not None
    process.send_signal(signal.SIGINT)
    assert process.stdout.readline().startswith(
        "stopping: waits for the call; Ctrl-C again ends at once"
    )
    process.send_signal(signal.SIGINT)
    output, _ = process.communicate(timeout=1_200)
    assert process.returncode == 130
    assert "interrupted; the last checkpoint is kept" in output


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_where_nothing_is_lost_the_first_signal_ends(number: signal.Signals) -> None:
    process = busy("nothing")
    process.send_signal(number)
    output, _ = process.communicate(timeout=1_200)
    assert (process.returncode, output) == (130, "interrupted\n")


@pytest.fixture(scope="module")
def config(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("config") / "tiny.yaml"
    path.write_text(TINY)
    return path


@pytest.mark.parametrize("after_s", [1.0, pytest.param(2.5, marks=pytest.mark.slow)])
def test_a_signal_while_a_training_starts_ends_it_with_130(
    after_s: float, config: Path, tmp_path: Path
) -> None:
    process = start_process(
        "-m", "rlcas_jax.train", "--config", config, "--out", tmp_path / "run", "--quiet"
    )
    time.sleep(after_s)
    process.send_signal(signal.SIGINT)
    output, _ = process.communicate(timeout=1_200)
    assert process.returncode == 130, output
    assert "Traceback" not in output


@pytest.mark.slow
def test_one_folder_has_one_training(config: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    process = start_process("-m", "rlcas_jax.train", "--config", config, "--out", out, "--quiet")
    try:
        deadline = time.monotonic() + 1_200
        while (
            time.monotonic() < deadline
            and len(metrics.read(out / metrics.FILE).get("update", ())) < 1
        ):
            time.sleep(0.05)
        with pytest.raises(
            ConfigError, match=f"--resume {out} is in use by process {process.pid} on "
        ):
            main(["--resume", str(out), "--quiet"])
    finally:
        process.kill()
        process.communicate()


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


class Clock:
    now = 100.0

    def __call__(self) -> float:
        return self.now


def row(step: int, score: float = 12.34, **more: float) -> dict[str, float]:
    return {"step": step, "steps_per_s": 31_234.5, "score": score, "success": 0.6123, **more}


def run(stream: io.StringIO, quiet: bool = False) -> str:
    clock = Clock()
    reporter = Reporter(quiet=quiet, stream=stream, clock=clock)
    reporter.start(total=10_000)
    for second in range(1, 26):
        clock.now += 1.0
        reporter.update(row(200 * second, **({"eval_success": 0.95} if second == 12 else {})))
    reporter.note("stopped")
    reporter.stop()
    return stream.getvalue()


def test_elsewhere_there_is_a_plain_line_every_ten_seconds_and_a_last_one():
    assert run(io.StringIO()).splitlines() == [
        "2 000 of 10 000 steps, 31 234 steps/s, score +12.3, success 61.2 %, 40 s left",
        "4 000 of 10 000 steps, 31 234 steps/s, score +12.3, success 61.2 %, deterministic 95.0 "
        "%, 30 s left",
        "stopped",
        "5 000 of 10 000 steps, 31 234 steps/s, score +12.3, success 61.2 %, deterministic 95.0 "
        "%, 25 s left",
    ]


def test_on_a_terminal_two_live_lines_fit_into_80_columns(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.setenv("COLUMNS", "80")
    shown = run(Terminal())
    assert "\x1b[" in shown
    assert "50% 5 000 of 10 000 steps 25 s left" in shown
    assert "31 234 steps/s, score +12.3, success 61.2 %, deterministic 95.0 %" in shown
    assert "stopped" in shown
    assert shown.rstrip().endswith("\x1b[?25h"), "the cursor is shown again"


@pytest.mark.parametrize("stream", [io.StringIO(), Terminal()])
def test_quiet_is_silent(stream: io.StringIO):
    assert run(stream, quiet=True) == ""


def test_before_the_first_episode_ends_there_is_no_score():
    stream, clock = io.StringIO(), Clock()
    reporter = Reporter(stream=stream, clock=clock)
    reporter.start(100_000, 50_000)
    reporter.update(row(55_000, score=math.nan))
    clock.now += 0.5
    reporter.update(row(60_000, score=math.nan))
    reporter.stop()
    assert stream.getvalue() == "60 000 of 100 000 steps, 31 234 steps/s, 4 s left\n"


def test_two_parts_that_end_together_do_not_halve_the_time_left():
    """Each of two workers takes 200 s for 500 encounters, and both began at once."""
    stream, clock = io.StringIO(), Clock()
    progress = Progress("encounters", stream=stream, clock=clock).start(16_000)
    for completed, seconds in ((500, 200.0), (1_000, 5.0)):
        clock.now += seconds
        progress.show(completed, "flying")
    assert stream.getvalue().splitlines() == [
        "500 of 16 000 encounters, flying, 1 h 43 min left",
        "1 000 of 16 000 encounters, flying, 51 min 15 s left",
    ]


def test_the_first_line_is_of_an_update_that_was_not_compiled():
    """The first update takes 50 s, the others 1 s: 98 of them are left."""
    stream, clock = io.StringIO(), Clock()
    reporter = Reporter(stream=stream, clock=clock)
    reporter.start(10_000)
    clock.now += 50.0
    reporter.update(row(100) | {"steps_per_s": 2.0})
    assert stream.getvalue() == ""
    clock.now += 1.0
    reporter.update(row(200) | {"steps_per_s": 100.0})
    assert stream.getvalue().endswith("100 steps/s, score +12.3, success 61.2 %, 1 min 38 s left\n")


def test_what_is_compiled_later_is_left_out_of_the_time_left():
    """A phase that begins after half of the updates, and takes 50 s to compile."""
    stream, clock = io.StringIO(), Clock()
    reporter = Reporter(stream=stream, clock=clock)
    reporter.start(10_000, 0, "compiling")
    assert stream.getvalue() == "compiling\n"
    for update in range(1, 51):
        clock.now += 1.0
        reporter.update(row(100 * update))
    clock.now += 51.0
    reporter.leave_out(51.0)
    reporter.update(row(5100))
    assert stream.getvalue().endswith("success 61.2 %, 48 s left\n")


def test_a_run_of_one_update_shows_it():
    stream = io.StringIO()
    reporter = Reporter(stream=stream, clock=Clock())
    reporter.start(100)
    reporter.update(row(100))
    reporter.stop()
    assert stream.getvalue().startswith("100 of 100 steps, 31 234 steps/s")


def test_a_run_that_does_nothing_shows_nothing():
    stream = io.StringIO()
    reporter = Reporter(stream=stream)
    reporter.start(10, 10)
    reporter.stop()
    assert stream.getvalue() == ""


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.2, "0 s"),
        (59.6, "1 min 0 s"),
        (200, "3 min 20 s"),
        (7500, "2 h 5 min"),
        (math.nan, "? s"),
    ],
)
def test_durations_in_words(seconds: float, text: str):
    assert duration(seconds) == text
