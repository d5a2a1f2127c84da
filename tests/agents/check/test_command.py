"""The command holds a certificate to an aircraft and a standard, and ends in a sentence."""

import json
from pathlib import Path
from typing import Any

import pytest

from agents.check import FORMAT, command, main
from agents.check.aircraft import Standard, check_aircraft, read_aircraft
from agents.check.reading import read
from agents.check.refusal import RefusedError
from tests.agents.check.certificates import climbing, edited, flight, intruder, straight

HEIGHTS = [0.0, 0.0, 700.0, 0.0, 0.0, 600.0]
RIGHT = straight(
    intruders=[intruder(5e4, 0.0)],
    requirement={"separation": 1_000.0, "margin": 20.0, "sigmas": 2.0},
    excluded=[HEIGHTS],
    apart=[[0, 1.0, 2.0, *HEIGHTS]],
    levels=[0.0, 0.0, 0.0, 0.0],
)
TEXT = """# Its limits.
speed_min_mps: 40.0
speed_max_mps: 90.0
acceleration_min_mps2: -0.5
acceleration_max_mps2: 0.4
yaw_rate_max_deg_s: 3.0
vehicle:
  speed_min_mps: 31.0  # m/s
  speed_max_mps: 100.0
  acceleration_min_mps2: -0.8
  acceleration_max_mps2: 0.5
  yaw_rate_max_deg_s: 5.2

separation_m: 1000.0
"""


def test_limits_of_the_vehicle_separations_and_the_standard_are_kept() -> None:
    aircraft = read_aircraft(TEXT)
    check_aircraft(read(RIGHT), aircraft)
    for path, value, message in (
        (("limits", "speed_min"), 30.9, "speed_min is 30.9, beyond"),
        (("limits", "speed_max"), 100.1, "speed_max is 100.1, beyond"),
        (("limits", "acceleration_min"), -0.81, "acceleration_min is -0.81, beyond"),
        (("limits", "acceleration_max"), 0.51, "acceleration_max is 0.51, beyond"),
        (("limits", "yaw_rate_max"), 0.0908, "yaw_rate_max is 0.0908, beyond"),
        (("own", 3), 29.8, "speed at the request is 29.8 m/s"),
        (("own", 3), 101.2, "speed at the request is 101.2 m/s"),
        (("requirement", "sigmas"), 1.9, r"counts 1.9 sigmas, below 2 \(--sigmas\)"),
        (("requirement", "separation"), 999.0, "its separation is 999 m, below"),
        (("intruders", 0, 9), 999.0, "from intruder 0 is 999 m, below"),
        (("excluded", 0, 5), 599.0, "a vertical separation is 599 m, below 600"),
        (("apart", 0, 8), 599.0, "a vertical separation is 599 m, below 600"),
    ):
        with pytest.raises(RefusedError, match=message):
            check_aircraft(read(edited(RIGHT, path, value)), aircraft)
    for path, value in (
        (("own", 3), 30.0),
        (("own", 3), 101.0),
        (("limits", "yaw_rate_max"), 0.0907),
    ):
        check_aircraft(read(edited(RIGHT, path, value)), aircraft)
    with pytest.raises(RefusedError, match="below 601 m"):
        check_aircraft(read(RIGHT), aircraft, Standard(vertical=601.0))
    with pytest.raises(RefusedError, match="below 3 "):
        check_aircraft(read(RIGHT), aircraft, Standard(sigmas=3.0))


CLIMBS = climbing(
    1_050.0,
    1_000.0,
    intruders=[intruder(5e4, 0.0)],
    requirement={"separation": 1_000.0, "margin": 20.0, "sigmas": 2.0},
    apart=[[0, 30.0, 30.0, 1_040.0, -2.5, 5_000.0, 0.0, 0.0, 137.2]],
)
UP_AND_DOWN = """climb_max_mps: 6.0
descent_max_mps: 6.0
vertical_acceleration_mps2: 1.0
vertical_separation_m: 137.2
"""


def test_limits_of_climbs_and_the_vertical_separation_of_the_aircraft_are_kept() -> None:
    aircraft = read_aircraft(TEXT + UP_AND_DOWN)
    check_aircraft(read(CLIMBS), aircraft)
    for path, value, message in (
        (("profile", "climb_max"), 6.1, "its climb_max_mps is 6.1, beyond the aircraft's, 6"),
        (("profile", "descent_max"), 6.1, "its descent_max_mps is 6.1, beyond"),
        (("profile", "acceleration"), 1.1, "its vertical_acceleration_mps2 is 1.1, beyond"),
        (("apart", 0, 8), 137.1, r"separation is 137.1 m, below 137.2 m \(the aircraft's\)"),
    ):
        with pytest.raises(RefusedError, match=message):
            check_aircraft(read(edited(CLIMBS, path, value)), aircraft)
    check_aircraft(read(edited(CLIMBS, ("profile", "climb_max"), 5.0)), aircraft)
    # A standard that is asked for holds too, and lowers nothing of the aircraft's.
    check_aircraft(read(CLIMBS), aircraft, Standard(vertical=100.0))
    for vertical, message in ((138.0, r"below 138 m \(--vertical"), (100.0, "below 137.2 m")):
        with pytest.raises(RefusedError, match=message):
            lower = edited(CLIMBS, ("apart", 0, 8), 120.0)
            check_aircraft(read(lower), aircraft, Standard(vertical=vertical))
    # A plan in the plane keeps the standard, whatever the aircraft's file states.
    with pytest.raises(RefusedError, match="below 600 m"):
        check_aircraft(read(edited(RIGHT, ("apart", 0, 8), 599.0)), aircraft)


@pytest.mark.parametrize("line", UP_AND_DOWN.splitlines())
def test_a_plan_climbs_with_an_aircraft_whose_file_says_how(line: str) -> None:
    aircraft = read_aircraft(TEXT + UP_AND_DOWN.replace(line, ""))
    check_aircraft(read(RIGHT), aircraft)
    with pytest.raises(RefusedError, match=f"the aircraft's file has no {line.partition(':')[0]}"):
        check_aircraft(read(CLIMBS), aircraft)


def test_an_aircraft_without_a_vehicle_is_one() -> None:
    alone = "\n".join(line for line in TEXT.splitlines() if line[:1] not in (" ", "v"))
    with pytest.raises(RefusedError, match="speed_min is 31, beyond"):
        check_aircraft(read(RIGHT), read_aircraft(alone))


@pytest.mark.parametrize(
    "line", TEXT.splitlines()[1:6] + TEXT.splitlines()[7:12] + TEXT.splitlines()[-1:]
)
def test_an_aircraft_file_has_each_number_once(line: str) -> None:
    name = line.partition(":")[0].strip()
    with pytest.raises(ValueError, match=f"{name} is missing"):
        read_aircraft(TEXT.replace(line, "", 1))
    with pytest.raises(ValueError, match="once each"):
        read_aircraft(TEXT.replace(line, f"{line}\n{line}", 1))
    with pytest.raises(ValueError, match="is no number"):
        read_aircraft(TEXT.replace(line, f"{line.partition(':')[0]}: fifty", 1))
    with pytest.raises(ValueError, match="expected key: number"):
        read_aircraft(TEXT.replace(line, line.replace(":", " "), 1))


def run(tmp_path: Path, data: Any, *options: str) -> int:
    path, aircraft = tmp_path / "plan.json", tmp_path / "aircraft.yaml"
    path.write_text(data if isinstance(data, str) else json.dumps(data))
    aircraft.write_text(TEXT)
    return main([str(path), *(str(aircraft) if option == "-" else option for option in options)])


def test_the_exit_status_says_what_came_of_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for data, options, status, answer, message in (
        (RIGHT, [], 0, "plan.json: accepted", ""),
        (RIGHT, ["--aircraft", "-"], 0, "plan.json: accepted", ""),
        (RIGHT, ["--aircraft", "-", "--sigmas", "3"], 1, "", "sigmas, below 3"),
        (RIGHT, ["--aircraft", "-", "--sigmas", "0"], 0, "accepted", ""),
        (RIGHT, ["--aircraft", "-", "--vertical-separation", "601"], 1, "", "below 601 m"),
        (RIGHT, ["--aircraft", "paper"], 0, "accepted", ""),
        (RIGHT, ["--aircraft", "papier"], 2, "", "papier: cannot be read: there is no such file"),
        (RIGHT | {"bounds": [1e6]}, [], 1, "", "plan.json: refused: intruder 0 may come too close"),
        (json.dumps(RIGHT)[:-1] + ',"parts":32}', [], 2, "", "the key 'parts' stands twice"),
        (json.dumps(RIGHT)[:-1], [], 2, "", "plan.json: cannot be read"),
        ("[" * 200_000, [], 2, "", "plan.json: cannot be read"),
    ):
        assert run(tmp_path, data, *options) == status
        out, err = capsys.readouterr()
        assert answer in out and message in err
        assert bool(out) != bool(err)


def test_options_that_cannot_be_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for options in (
        ["--sigmas", "3"],
        ["--vertical-separation", "600"],
        ["--aircraft", "-", "--sigmas", "-1"],
        ["--aircraft", "-", "--sigmas", "nan"],
        ["--aircraft", "-", "--sigmas", "1e8"],
    ):
        with pytest.raises(SystemExit) as ended:
            run(tmp_path, RIGHT, *options)
        assert ended.value.code == 2
    with pytest.raises(SystemExit):
        main(["--version"])
    assert FORMAT in capsys.readouterr().out


def test_what_is_no_moderate_file_is_not_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert main([str(tmp_path)]) == 2
    assert main([str(tmp_path / "none")]) == 2
    large = tmp_path / "large.json"
    with large.open("wb") as file:
        file.truncate((1 << 26) + 1)
    assert main([str(large)]) == 2
    refused = capsys.readouterr().err.splitlines()
    expected = ("not a regular file", "no such file", "larger than 64 MiB")
    assert all(problem in line for problem, line in zip(expected, refused, strict=True))

    def interrupt(_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(command, "accept", interrupt)
    assert run(tmp_path, RIGHT) == 130
    assert capsys.readouterr().err == "interrupted\n"


def test_what_is_proven_is_said() -> None:
    lines = command.summary(read(RIGHT))
    assert lines[0] == (
        "intruders: 1; none comes closer than 1.000 m until 40.0 s after the request, "
        "but while 600 m or more above or below: 0"
    )
    assert lines[1] == "left out: 1, 600 m or more above or below"
    assert (
        "climbs: waypoints at 1000.0 to 1050.0 m within 5 m, 6 m/s up and 6 m/s down at most, "
        "1 m/s^2, 137.2 m above or below others"
    ) in command.summary(read(CLIMBS))
    levels = climbing(1_000.0, profile={"floor": 900.0, "ceiling": 1_200.0})
    expected = "1 m/s^2, floor 900 m, ceiling 1200 m, nobody is passed above or below"
    assert expected in "\n".join(command.summary(read(levels)))
    assert (
        "intruders: none; the flight is proven until 20.0 s"
        in command.summary(read(flight((0.0, 0.0))))[0]
    )
