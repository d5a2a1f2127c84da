"""Two processes never write into one run folder."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from agents.config.folder_lock import LOCK, is_unused, locked
from agents.config.load import ConfigError

HOLD = """
import sys, time
from pathlib import Path
from agents.config.folder_lock import locked
with locked(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(60)
"""


def test_a_folder_in_use_is_refused_until_its_process_is_killed(tmp_path: Path) -> None:
    folder = tmp_path / "new" / "run"
    holder = subprocess.Popen([sys.executable, "-c", HOLD, str(folder)], stdout=subprocess.PIPE, text=True)
    assert holder.stdout is not None
    assert holder.stdout.readline() == "held\n"
    with pytest.raises(ConfigError, match=f"--resume {folder} .* process {holder.pid} on "), locked(folder, "--resume"):
        pass
    holder.send_signal(signal.SIGKILL)
    holder.communicate()
    with locked(folder):
        pass


def test_a_lock_ends_with_its_block(tmp_path: Path) -> None:
    with locked(tmp_path), pytest.raises(ConfigError), locked(tmp_path):
        pass
    with locked(tmp_path):
        pass


def test_a_folder_with_nothing_but_a_lock_is_unused(tmp_path: Path) -> None:
    assert is_unused(tmp_path / "none")
    with locked(tmp_path):
        assert is_unused(tmp_path)
    (tmp_path / "other").touch()
    assert not is_unused(tmp_path)
    assert not is_unused(tmp_path / LOCK)


def test_a_folder_that_cannot_be_made_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(ConfigError, match="cannot be written"), locked(tmp_path / "file" / "run"):
        pass
