"""Files that cannot be read are refused at once, in one sentence that names them, by every reader."""

import gzip
import os
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from envs.encounters import EncounterError
from envs.formats import encounter_file
from envs.formats.adsb_pairs import adsb_pairs
from envs.formats.lincoln_file import read_lincoln
from envs.formats.track_files import read_daidalus
from envs.traffic.encounter_model import read_model
from envs.traffic.text_file import json_of, lines_of, text_of
from envs.traffic.tracks import TrackError

READERS: dict[str, tuple[Callable[[Any], Any], type[Exception]]] = {
    "csv": (encounter_file.read, EncounterError),
    "lincoln": (read_lincoln, TrackError),
    "daidalus": (read_daidalus, TrackError),
    "adsb": (adsb_pairs, TrackError),
    "model": (read_model, EncounterError),
}
MIB = 2**20


@pytest.fixture(scope="module")
def bomb(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a gzip file of some 100 kilobytes that unpacks to 129 MiB of blanks."""
    path = tmp_path_factory.mktemp("bomb") / "bomb.json.gz"
    packer = zlib.compressobj(1, zlib.DEFLATED, 31)
    with path.open("wb") as file:
        for _ in range(129):
            file.write(packer.compress(b" " * MIB))
        file.write(packer.flush())
    return path


@pytest.mark.parametrize("reader", READERS)
def test_what_is_no_regular_file_is_refused_at_once(reader: str, tmp_path: Path) -> None:
    read, kind = READERS[reader]
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", tmp_path, Path("/dev/zero"), tmp_path / "none"):
        with pytest.raises(kind, match=f"{path}: (cannot be read: not a regular file|there is no such file)"):
            read(path)


@pytest.mark.parametrize("reader", READERS)
def test_unpacking_ends_at_a_bound(reader: str, bomb: Path) -> None:
    read, kind = READERS[reader]
    assert bomb.stat().st_size < MIB
    with pytest.raises(kind, match=r"bomb\.json\.gz: more than 128 MiB unpacked, expected at most so much"):
        read(bomb)


def test_a_plain_file_has_the_same_bound(tmp_path: Path) -> None:
    path = tmp_path / "large.txt"
    with path.open("wb") as file:
        file.truncate(129 * MIB)
    with pytest.raises(TrackError, match="more than 128 MiB, expected"):
        text_of(str(path), TrackError)


@pytest.mark.parametrize("cut", [2, 12, 40, -1])
def test_a_gzip_file_that_is_cut_off_is_refused(tmp_path: Path, cut: int) -> None:
    path = tmp_path / "cut.json.gz"
    path.write_bytes(gzip.compress(b"[1, 2, 3]" + os.urandom(100).hex().encode())[:cut])
    with pytest.raises(TrackError, match="not a gzip file, or cut off"):
        json_of(str(path), TrackError)


def test_lines_lists_and_depth_are_bounded(tmp_path: Path) -> None:
    path = tmp_path / "many"
    path.write_bytes(b"\n" * 2_000_001)
    with pytest.raises(TrackError, match="more than 2000000 lines"):
        lines_of(str(path), TrackError)
    path.write_bytes(b"[" + b"[]," * 10_000_000 + b"1]")
    with pytest.raises(TrackError, match="more than 10000000 lists"):
        json_of(str(path), TrackError)
    path.write_text('[{"latitude": 1, "latitude": 2}]')
    with pytest.raises(TrackError, match="not usable as JSON: 'latitude' stands twice in one object"):
        json_of(str(path), TrackError)
    path.write_bytes(b"[" * 100_000)
    with pytest.raises(TrackError, match="not usable as JSON"):
        json_of(str(path), TrackError)


def test_text_is_utf_8_with_or_without_a_byte_order_mark(tmp_path: Path) -> None:
    path = tmp_path / "text"
    for data in ("\ufeffé".encode(), "é".encode(), gzip.compress("é".encode())):
        path.write_bytes(data)
        assert text_of(str(path), TrackError) == "é"
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(TrackError, match=r"not a text in UTF-8 \(byte 0\)"):
        text_of(str(path), TrackError)
