"""The areas of a file are drawn, or it is said why not."""

from pathlib import Path

import pytest

from agents.config.load import ConfigError
from envs.areas import Area, AreaError, Circle, Keep, Polygon
from envs.formats.areas import write_areas
from envs.formats.local_frame import LocalFrame
from eval.areas.run import main, picture

PLACE = ["--latitude", "47", "--longitude", "8"]
AREAS = [
    Area(Polygon(((0.0, 0.0), (4e3, 0.0), (0.0, 3e3)), (((5e2, 5e2), (9e2, 5e2), (5e2, 9e2)),))),
    Area(Circle(7e3, 1e3, 2e3), Keep.IN, velocity=(5.0, 0.0), name="cell"),
]


def test_a_file_becomes_a_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, out, again = tmp_path / "a.geojson", tmp_path / "first", tmp_path / "again"
    write_areas(file, AREAS, LocalFrame(47.0, 8.0))
    assert main([str(file), *PLACE, "--out", str(out)]) == 0
    assert (out / "areas.png").read_bytes().startswith(b"\x89PNG")
    assert "2 areas" in capsys.readouterr().out
    assert main(["--config", str(out / "config.yaml"), "--out", str(again)]) == 0
    names = {path.name for path in out.iterdir()}
    assert names == {"areas.png", "areas.svg", "config.yaml"}
    for name in names:
        assert (again / name).read_bytes() == (out / name).read_bytes()


def test_bad_input_is_refused_in_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(AreaError, match="there is no such file"):
        main([str(tmp_path / "none"), *PLACE])
    with pytest.raises(ConfigError, match="expected FILE, --latitude and --longitude"):
        main(PLACE)


def test_nothing_near_is_no_success(tmp_path: Path) -> None:
    file, out = tmp_path / "a.geojson", tmp_path / "out"
    write_areas(file, AREAS[:1], LocalFrame(8.0, 47.0))
    with pytest.raises(AreaError, match="exchanged it would be 0 km"):
        main([str(file), *PLACE, "--out", str(out)])
    write_areas(file, [], LocalFrame(47.0, 8.0))
    with pytest.raises(AreaError, match="holds none"):
        main([str(file), *PLACE, "--out", str(out)])
    assert not out.exists()


def test_the_picture_shows_all_of_every_area() -> None:
    (axes,) = picture(AREAS).axes
    (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
    assert (west < 0.0, east > 9.0) == (True, True)
    assert (south < -1.0, north > 3.0) == (True, True)
    assert [text.get_text() for text in axes.texts][1] == "cell"
