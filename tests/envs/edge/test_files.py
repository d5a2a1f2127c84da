"""Files are written whole or not at all, and only regular ones are read."""

import errno
import os
from pathlib import Path

import pytest

from envs.edge.command import ConfigError
from envs.edge.files import check_regular, check_space, write_file, written


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


def test_a_full_disk_leaves_the_old_file_and_names_it(tmp_path: Path):
    target = tmp_path / "a.txt"
    write_file(target, "old")
    with pytest.raises(OSError, match=r"a\.txt") as caught, written(target) as path:
        fail(path)
    assert caught.value.errno == errno.ENOSPC
    assert target.read_text(encoding="utf-8") == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_an_error_about_another_file_keeps_its_name(tmp_path: Path):
    source = tmp_path / "folder" / "source.txt"
    with pytest.raises(FileNotFoundError) as caught, written(tmp_path / "a.txt"):
        source.read_text(encoding="utf-8")
    assert caught.value.filename == str(source)


@pytest.mark.parametrize("target", ["none/a.txt", "folder"])
def test_what_cannot_be_written_is_refused_before_the_work(tmp_path: Path, target: str):
    (tmp_path / "folder").mkdir()
    with pytest.raises(OSError) as caught, written(tmp_path / target):
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
