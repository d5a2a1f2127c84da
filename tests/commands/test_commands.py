"""The edge of every program: options, the guard, a base installation, files, text, and locks of
folders.
"""

import errno
import importlib
import os
import re
import signal
import stat
import subprocess
import sys
import unicodedata
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from commands import compiled
from commands.command import ConfigError, InputError, Parser, run_cli, visible
from commands.files import check_regular, check_space, write_file, write_whole
from commands.folder_lock import LOCK, is_unused, lock
from commands.installation import PACKAGES, extra_of

ROOT = Path(__file__).resolve().parents[2]
BLOCKER = """
import sys
class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] not in {{*sys.stdlib_module_names, *{names!r}}}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Blocker())
"""
VERSIONS = """
import runpy, sys
for name in sys.argv[1:]:
    sys.argv = [name, "--version"]
    try:
        runpy.run_module(name, run_name="__main__", alter_sys=True)
    except SystemExit as end:
        assert not end.code, name
"""


def parser() -> Parser:
    made = Parser(prog="prog")
    made.add_argument("--scenario")
    made.add_argument("--set", action="append", default=[])
    made.add_argument("--repair", action="store_true")
    return made


def program(
    body: str, *arguments: str, before: str = "", **environment: str
) -> subprocess.CompletedProcess[str]:
    text = (
        f"from pathlib import Path\nfrom commands.command import *\n{before}\ndef main():\n   "
        f" {body}\nrun_cli(main)"
    )
    command = [sys.executable, "-c", text, *arguments]
    return subprocess.run(
        command,
        cwd=ROOT,
        env=os.environ | environment,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["--scenario", "a", "--scenario", "b"], "--scenario stands twice"),
        (["--scenario=a", "--scenario=a"], "--scenario stands twice"),
        (["--scenario", "\udcff"], "UTF-8"),
        (["--scen", "a"], "unrecognized"),
    ],
)
def test_arguments_that_argparse_takes_silently_are_refused(arguments: list[str], word: str):
    with pytest.raises(ConfigError, match=word):
        parser().parse_args(arguments)


def test_an_option_may_be_given_once_in_every_parse():
    made = parser()
    for _ in range(2):
        found = made.parse_args(["--scenario", "a", "--set", "x=1", "--set", "y=2", "--repair"])
        assert (found.scenario, found.set, found.repair) == ("a", ["x=1", "y=2"], True)


@pytest.mark.parametrize(
    ("body", "status", "start"),
    [
        ("raise ConfigError('bad\\n  thing')", 2, "error: bad thing"),
        ("raise MemoryError", 1, "error: out of memory: MemoryError"),
        ("raise OverflowError('int too large')", 1, "error: a number too large: int too large"),
        ("main()", 1, "error: nested too deeply"),
        (
            "raise OSError(28, 'No space left on device', 'runs/x.png')",
            1,
            "error: runs/x.png: No space left",
        ),
        (
            "raise ConfigError('x.csv: full') from OSError(28, 'No space left')",
            1,
            "error: x.csv: full",
        ),
        (
            "raise ConfigError('x.csv: no') from OSError(13, 'Permission denied')",
            2,
            "error: x.csv: no",
        ),
        (
            "from commands.files import check_space; check_space(Path('/tmp/x'), 10**18, 'a file')",
            1,
            "error: --out /tmp/x: ",
        ),
        ("import pyarrow_ as x", 1, "Traceback"),
        ("1 / 0", 1, "Traceback"),
    ],
)
def test_what_a_user_can_cause_is_one_sentence(body: str, status: int, start: str):
    result = program(body)
    assert (result.returncode, result.stdout) == (status, "")
    assert result.stderr.startswith(start)
    assert start == "Traceback" or result.stderr.count("\n") == 1


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_a_full_disk_under_the_output_is_one_sentence():
    text = "from commands.command import run_cli; run_cli(lambda: print('x' * 10_000))"
    with Path("/dev/full").open("w") as full:
        command = [sys.executable, "-c", text]
        result = subprocess.run(
            command, cwd=ROOT, stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )
    assert result.returncode == 1
    assert re.fullmatch(r"error: .*No space left on device\n", result.stderr)


def test_a_package_of_the_same_name_in_front_is_refused(tmp_path: Path):
    (tmp_path / "agents").mkdir()
    (tmp_path / "agents" / "__init__.py").touch()
    result = program("pass", before=f"import sys; sys.path.insert(0, {str(tmp_path)!r})")
    assert result.returncode == 2
    assert result.stderr.startswith("error: the package agents is ")


def commands() -> list[str]:
    """Return every module of the five packages that is a program."""
    found = []
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*.py"):
            if '\nif __name__ == "__main__":' in path.read_text(encoding="utf-8"):
                parts = path.relative_to(ROOT).with_suffix("").parts
                found.append(".".join(parts[:-1] if parts[-1] == "__main__" else parts))
    return sorted(set(found) - {"agents.check"})  # which is to import nothing of the project


@pytest.mark.slow
def test_without_extras_every_program_has_help_that_names_what_to_install(tmp_path: Path):
    names = {*PACKAGES, "numpy", "safetensors", "sitecustomize"}
    (tmp_path / "sitecustomize.py").write_text(BLOCKER.format(names=names), encoding="utf-8")
    environment = os.environ | {"PYTHONPATH": f"{tmp_path}{os.pathsep}{ROOT}"}

    def start(*arguments: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, *arguments]
        return subprocess.run(
            command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False
        )

    modules = commands()
    assert len(modules) > 20
    with ThreadPoolExecutor(2) as pool:
        answers = pool.map(lambda module: start("-m", module, "--help"), modules)
        for module, result in zip(modules, answers, strict=True):
            assert result.returncode == 0 and not result.stderr, (module, result.stderr)
            installs = re.search(
                r"^.{20}[^\0]*once \w+ is installed: pip install 'rlcas-toolkit\[\w+\]'$",
                result.stdout,
                re.MULTILINE,
            )
            assert installs or result.stdout.startswith("usage: "), (module, result.stdout)
    result = start("-m", "rlcas_jax.train", "--config", "quick")
    assert result.returncode == 2
    assert re.fullmatch(r"error: \w+ is not installed; .*rlcas-toolkit\[train\]'\n", result.stderr)
    result = start("-c", VERSIONS, *modules)
    assert result.stdout.count("rlcas-toolkit") == len(modules), result.stdout + result.stderr


def test_the_extra_is_that_of_the_command():
    assert extra_of("pydantic", "eval.rare.run:main") == "report"
    assert extra_of("pydantic", "rlcas_jax.train:main") == "train"
    assert extra_of("matplotlib", "ros_bridge.demo:main") == "ros"
    assert extra_of("matplotlib", "ros_bridge.mavlink.demo:main") == "report"
    assert extra_of("serial", "ros_bridge.mavlink.program:main") == "mavlink"
    assert extra_of("jax.numpy", "") == "train"
    assert extra_of("agents.nothing", "") is None


NOTEBOOK = {"MPLBACKEND": "module://matplotlib_inline.backend_inline", "PYTHONIOENCODING": "ascii"}


def test_neither_a_backend_nor_an_encoding_ends_a_program():
    body = "from matplotlib.figure import Figure; Figure().savefig('/dev/null'); print('1 ± 0')"
    result = program(body, **NOTEBOOK)
    assert (result.returncode, result.stdout, result.stderr) == (0, "1 \\xb1 0\n", "")


@pytest.mark.slow
def test_every_program_starts_with_what_a_notebook_hands_on():
    for module in commands():
        result = subprocess.run(
            [sys.executable, "-m", module, "--help"],
            cwd=ROOT,
            env=os.environ | NOTEBOOK,
            capture_output=True,
            text=True,
            check=False,
        )
        assert (result.returncode, result.stderr) == (0, ""), module


MAVLINK = "--connect", "tcp:127.0.0.1:1"  # where nothing listens
SCHEDULER = "--scheduler", "tcp://127.0.0.1:1"


@pytest.mark.parametrize(
    ("command", "arguments", "asker", "module"),
    [
        ("ros_bridge.mavlink.program", (*MAVLINK, "--record", "a.mcap"), "--record", "mcap"),
        ("ros_bridge.mavlink.program", (*MAVLINK, "--record", "a.mcap"), "--record", "mcap_ros2"),
        ("ros_bridge.mavlink.program", (*MAVLINK, "--display"), "--display", "websockets"),
        ("ros_bridge.mavlink.demo", ("--record", "a.mcap"), "--record", "mcap"),
        ("ros_bridge.mavlink.demo", (), "--out", "matplotlib"),
        ("ros_bridge.demo", ("--record", "a.mcap"), "--record", "mcap"),
        ("ros_bridge.demo", ("--display",), "--display", "websockets"),
        ("eval.monte_carlo.run", (*SCHEDULER, "--out", "run"), "--scheduler", "distributed"),
        ("eval.monte_carlo.run", ("--set", "backend=jax", "--out", "run"), "backend jax", "jax"),
        ("eval.hifi.run", ("--out", "run"), "vehicle c208_ex", "jsbsim"),
        ("eval.evidence.run", ("--only", "results", *SCHEDULER), "--scheduler", "distributed"),
    ],
)
def test_what_an_option_needs_is_asked_for_before_anything_begins(
    command: str,
    arguments: tuple[str, ...],
    asker: str,
    module: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    main = importlib.import_module(command).main
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, module, None)  # as if it were not installed
    with pytest.raises(SystemExit) as ended:
        run_cli(lambda: main(list(arguments)))
    assert ended.value.code == 2
    says = rf"error: {asker} needs {module}, which is not installed; .*rlcas-toolkit\[\w+\]'\n"
    assert re.fullmatch(says, capsys.readouterr().err)
    assert not list(tmp_path.iterdir())


def test_a_refused_policy_is_bad_input():
    def main() -> None:
        raise InputError("no such policy file")

    with pytest.raises(SystemExit) as ended:
        run_cli(main)
    assert ended.value.code == 2


# Files are written whole or not at all, and only regular ones are read.


def test_a_file_is_replaced_whole(tmp_path: Path):
    target = tmp_path / "a.txt"
    write_file(target, "old")
    write_file(target, b"new")
    assert target.read_bytes() == b"new"
    assert target.stat().st_mode & 0o777 == 0o644
    assert list(tmp_path.iterdir()) == [target]


def fail(path: Path) -> None:
    path.write_text("half", encoding="utf-8")
    raise OSError(errno.ENOSPC, "No space left on device")


def test_a_pipe_or_device_is_not_replaced_by_a_file(tmp_path: Path):
    target = tmp_path / "pipe"
    os.mkfifo(target)
    with pytest.raises(PermissionError, match="pipe"):
        write_file(target, "new")
    assert stat.S_ISFIFO(target.stat().st_mode)
    assert list(tmp_path.iterdir()) == [target]


def test_a_full_disk_leaves_the_old_file_and_names_it(tmp_path: Path):
    target = tmp_path / "a.txt"
    write_file(target, "old")
    with pytest.raises(OSError, match=r"a\.txt") as caught, write_whole(target) as path:
        fail(path)
    assert caught.value.errno == errno.ENOSPC
    assert target.read_text(encoding="utf-8") == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_an_error_about_another_file_keeps_its_name(tmp_path: Path):
    source = tmp_path / "folder" / "source.txt"
    with pytest.raises(FileNotFoundError) as caught, write_whole(tmp_path / "a.txt"):
        source.read_text(encoding="utf-8")
    assert caught.value.filename == str(source)


@pytest.mark.parametrize("target", ["none/a.txt", "folder"])
def test_what_cannot_be_written_is_refused_before_the_work(tmp_path: Path, target: str):
    (tmp_path / "folder").mkdir()
    with pytest.raises(OSError) as caught, write_whole(tmp_path / target):
        pytest.fail("the block was entered")
    assert caught.value.filename == str(tmp_path / target)


def test_a_named_pipe_is_no_regular_file(tmp_path: Path):
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", tmp_path, tmp_path / "none"):
        with pytest.raises(OSError):
            check_regular(path)


def test_a_disk_without_room_is_refused_by_name(tmp_path: Path):
    check_space(tmp_path / "new", 1, "a file")
    with pytest.raises(ConfigError, match="MB are free there, expected about"):
        check_space(tmp_path / "new" / "deep", 10**18, "a file")
    assert list(tmp_path.iterdir()) == []


# Text from files on its way to a reader.


@given(st.text())
def test_nothing_invisible_is_left_in_a_visible_text(text: str) -> None:
    shown = visible(text)
    assert not [
        each for each in shown if unicodedata.category(each) in {"Cc", "Cf"} and each != "\n"
    ]
    assert visible(shown) == shown


def test_an_error_shows_a_reversing_character_as_its_code(
    capsys: pytest.CaptureFixture[str],
) -> None:
    def main() -> int:
        raise InputError("encounter 'a\u202eb' is unknown")

    with pytest.raises(SystemExit):
        run_cli(main)
    assert capsys.readouterr().err == "error: encounter 'a\\u202eb' is unknown\n"


# Two processes never write into one run folder.


HOLD = """
import sys, time
from pathlib import Path
from commands.folder_lock import lock
with lock(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(60)
"""


def test_a_folder_in_use_is_refused_until_its_process_is_killed(tmp_path: Path) -> None:
    folder = tmp_path / "new" / "run"
    holder = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(folder)], stdout=subprocess.PIPE, text=True
    )
    assert holder.stdout is not None
    assert holder.stdout.readline() == "held\n"
    with (
        pytest.raises(ConfigError, match=f"--resume {folder} .* process {holder.pid} on "),
        lock(folder, "--resume"),
    ):
        pass
    holder.send_signal(signal.SIGKILL)
    holder.communicate()
    with lock(folder):
        pass


def test_a_lock_ends_with_its_block(tmp_path: Path) -> None:
    with lock(tmp_path), pytest.raises(ConfigError), lock(tmp_path):
        pass
    with lock(tmp_path):
        pass


def test_a_folder_with_nothing_but_a_lock_is_unused(tmp_path: Path) -> None:
    assert is_unused(tmp_path / "none")
    with lock(tmp_path):
        assert is_unused(tmp_path)
    (tmp_path / "other").touch()
    assert not is_unused(tmp_path)
    assert not is_unused(tmp_path / LOCK)


def test_a_folder_that_cannot_be_made_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(ConfigError, match="cannot be written"), lock(tmp_path / "file" / "run"):
        pass


def compile_folder(monkeypatch: pytest.MonkeyPatch, cache: Path) -> str | None:
    """Return the folder that JAX is given where this is the user's cache folder."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(cache))
    monkeypatch.delenv("JAX_COMPILATION_CACHE_DIR", raising=False)
    compiled.keep_compiled()
    return os.environ.get("JAX_COMPILATION_CACHE_DIR")


def test_another_processor_keeps_its_programs_elsewhere(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    here = compile_folder(monkeypatch, tmp_path)
    assert here is not None
    assert Path(here).is_dir()
    assert compile_folder(monkeypatch, tmp_path) == here
    monkeypatch.setattr(compiled, "_processor", lambda: "without AVX-512")
    elsewhere = compile_folder(monkeypatch, tmp_path)
    assert elsewhere is not None
    assert elsewhere != here


def test_kept_programs_stay_below_their_bound(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(compiled, "_LARGE", 1000)
    first = tmp_path / "rlcas-toolkit" / "compiled" / "older" / "program"
    first.parent.mkdir(parents=True)
    first.write_bytes(bytes(1000))
    assert compile_folder(monkeypatch, tmp_path)
    assert first.is_file()
    first.write_bytes(bytes(1001))
    assert compile_folder(monkeypatch, tmp_path)
    assert not first.is_file()


def test_a_cache_folder_that_cannot_be_used_is_left_alone(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("")
    assert compile_folder(monkeypatch, tmp_path / "file") is None
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", "mine")
    compiled.keep_compiled()
    assert os.environ["JAX_COMPILATION_CACHE_DIR"] == "mine"
