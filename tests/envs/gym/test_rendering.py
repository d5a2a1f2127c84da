"""Pictures show what they should, and bad input of the environments is refused in a sentence."""

import math
import os
import shutil
import subprocess
import sys

import gymnasium
import matplotlib.colors
import numpy as np
import pytest
from gymnasium import error

from envs.encounters import EncounterError
from envs.gym.gymnasium_env import ENV_ID, DeconflictionEnv
from envs.gym.gymnasium_vector import DeconflictionVectorEnv
from envs.gym.rendering import GOAL, INTRUDER, OWNSHIP, VIOLATION, Drawing, Picture, view
from envs.outcome import RULES
from tests.envs.gym.test_gymnasium_env import STRAIGHT, batch, encounter, vector

SIZE = 512


def scene(steps=40, intruders=1, miss=2500.0, **changes) -> Picture:
    """Own eastwards through the origin, intruders southwards at a distance behind each other."""
    time = np.arange(steps + 1.0)
    own = np.stack([-4000.0 + 75.0 * time, 0 * time, 0 * time, 75.0 + 0 * time], axis=-1)
    traffic = np.stack(
        [
            np.stack(
                [
                    0 * time + 1500.0 * k,
                    4000.0 + miss - 75.0 * time,
                    0 * time - np.pi / 2,
                    75.0 + 0 * time,
                ],
                -1,
            )
            for k in range(intruders)
        ],
        axis=1,
    )
    separations = np.hypot(*np.moveaxis(traffic[..., :2] - own[:, None, :2], -1, 0))
    picture = Picture(
        own, traffic, separations, (4000.0, 0.0), 500.0, 1000.0, float(steps), "flying", "made up"
    )
    return picture._replace(**changes)


def pixels(picture: np.ndarray, colour: str) -> int:
    """Pixels of exactly a colour."""
    expected = np.round(np.array(matplotlib.colors.to_rgb(colour)) * 255.0).astype(np.uint8)
    return int(np.count_nonzero(np.all(picture == expected, axis=-1)))


@pytest.mark.parametrize("size", [512, 800])
def test_a_frame_is_a_picture_of_the_size_asked_for(size):
    picture = Drawing(size).frame(scene())
    assert picture.shape == (size, size, 3)
    assert picture.dtype == np.uint8
    assert picture.flags.writeable


def test_everything_is_there_in_its_colour():
    picture = Drawing(SIZE).frame(scene())
    for colour in (OWNSHIP, INTRUDER, GOAL):
        assert pixels(picture, colour) > 60
    assert pixels(picture, VIOLATION) == 0
    assert pixels(Drawing(SIZE).frame(scene(intruders=6)), INTRUDER) > 3 * pixels(picture, INTRUDER)


def test_trails_turn_red_where_separation_is_lost():
    lost = scene(steps=60, miss=0.0)
    assert lost.separations.min() < 1000.0 < lost.separations[30].min()
    assert pixels(Drawing(SIZE).frame(lost), VIOLATION) > 100
    before = Picture(*(part[:31] if isinstance(part, np.ndarray) else part for part in lost))
    assert pixels(Drawing(SIZE).frame(before), VIOLATION) == 0


@pytest.mark.parametrize(("outcome", "colour"), [("reached", GOAL), ("violation", VIOLATION)])
def test_the_verdict_is_written_in_its_colour(outcome, colour):
    header = SIZE // 14
    flying, ended = (
        Drawing(SIZE).frame(scene(outcome=name))[:header] for name in ("flying", outcome)
    )
    assert pixels(flying, colour) == 0
    assert pixels(ended, colour) > 20


def test_the_goal_has_its_radius():
    picture = Drawing(SIZE).frame(scene(goal_radius=900.0))
    assert pixels(picture, GOAL) > pixels(Drawing(SIZE).frame(scene(goal_radius=450.0)), GOAL)


def test_a_drawing_used_again_draws_what_a_new_one_draws():
    drawing = Drawing(SIZE)
    scenes = [
        scene(intruders=4),
        scene(steps=0),
        scene(steps=90, outcome="reached"),
        scene(intruders=2, miss=0.0),
    ]
    pictures = [drawing.frame(drawn) for drawn in scenes]
    for drawn, picture in zip(scenes, pictures, strict=True):
        np.testing.assert_array_equal(picture, Drawing(SIZE).frame(drawn))
    assert not np.array_equal(pictures[0], pictures[1])


def test_the_view_holds_what_matters_and_only_grows():
    complete = scene(steps=300)
    sides = []
    for steps in range(0, 301, 20):
        part = Picture(
            *(field[: steps + 1] if isinstance(field, np.ndarray) else field for field in complete)
        )
        west, south, side = view(part)
        sides.append(side)
        for x, y in [
            part.own[-1, :2] / 1000.0,
            np.array(part.goal) / 1000.0,
            part.intruders[0, 0, :2] / 1000.0,
        ]:
            assert west + 1.0 < x < west + side - 1.0
            assert south + 1.0 < y < south + side - 1.0
    assert sides == sorted(sides)


def test_the_environment_draws_every_step_anew():
    env = gymnasium.make(ENV_ID, scenario="multi", render_mode="rgb_array", render_size=SIZE)
    with pytest.raises(error.ResetNeeded, match="render was called before reset"):
        env.unwrapped.render()
    env.reset(seed=0)
    pictures = [env.render()]
    for _ in range(3):
        env.step(np.zeros(2, np.float32))
        pictures.append(env.render())
    assert len({picture.tobytes() for picture in pictures}) == 4
    assert all(pixels(picture, OWNSHIP) > 40 for picture in pictures)
    np.testing.assert_array_equal(env.render(), pictures[-1])
    env.close()


def test_no_picture_without_a_render_mode():
    env = gymnasium.make(ENV_ID).unwrapped
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="render draws nothing"):
        assert env.render() is None


def in_a_new_interpreter(code: str, **variables: str) -> subprocess.CompletedProcess[str]:
    clean = {
        key: value
        for key, value in os.environ.items()
        if key not in ("DISPLAY", "WAYLAND_DISPLAY", "MPLBACKEND")
    }
    command = [sys.executable, "-W", "error", "-c", code]
    return subprocess.run(
        command, env=clean | variables, capture_output=True, text=True, timeout=1_200, check=False
    )


@pytest.mark.skipif(
    not sys.platform.startswith("linux"), reason="other systems have a display without being asked"
)
@pytest.mark.parametrize("backend", ["", "TkAgg"])
def test_human_mode_without_a_display_says_what_to_do(backend):
    code = f"""
import gymnasium
try:
    gymnasium.make("envs.gym.gymnasium_env:{ENV_ID}", render_mode="human").reset(seed=0)
except gymnasium.error.UnsupportedMode as problem:
    print(problem)
"""
    result = in_a_new_interpreter(code, **({"MPLBACKEND": backend} if backend else {}))
    assert result.returncode == 0, result.stderr
    assert result.stdout.startswith('render_mode "human": a window needs a display')
    assert result.stdout.count("\n") == 1
    assert 'render_mode="rgb_array"' in result.stdout


HUMAN = f"""
import gymnasium, numpy as np
from gymnasium.utils.env_checker import check_env
from PIL import ImageGrab
env = gymnasium.make("envs.gym.gymnasium_env:{ENV_ID}", render_mode="human").unwrapped
check_env(env)
env.metadata["render_fps"] = 1000
env.close()
env.reset(seed=0)
for _ in range(5):
    env.step(np.zeros(2, np.float32))
screen = np.asarray(ImageGrab.grab().convert("RGB"))
assert np.count_nonzero(np.all(screen == (0, 0x72, 0xb2), axis=-1)) > 60, "no ownship on the screen"
import matplotlib.pyplot as plt
plt.close("all")
env.step(np.zeros(2, np.float32))
env.reset()
assert plt.get_fignums(), "no new window after the user has closed the old one"
env.close()
assert not plt.get_fignums()
print("shown")
"""


@pytest.mark.slow
def test_human_mode_shows_a_window():
    server = shutil.which("Xvfb")
    if server is None:
        pytest.skip("Xvfb is not installed: the window is not tested")
    pytest.importorskip("tkinter")
    reading, writing = os.pipe()
    with subprocess.Popen(
        [server, "-displayfd", str(writing), "-screen", "0", "800x800x24", "-nolisten", "tcp"],
        pass_fds=[writing],
        stderr=subprocess.DEVNULL,
    ) as display:
        os.close(writing)
        try:
            with os.fdopen(reading) as pipe:
                number = pipe.readline().strip()
            result = in_a_new_interpreter(HUMAN, DISPLAY=f":{number}", MPLBACKEND="TkAgg")
        finally:
            display.terminate()
    assert result.returncode == 0, result.stderr
    assert result.stdout.strip() == "shown"


@pytest.mark.parametrize(
    "make", [DeconflictionEnv, lambda **options: vector(2, **options)], ids=["single", "vector"]
)
class TestBadInput:
    @pytest.mark.parametrize(
        ("action", "sentence"),
        [
            ([0.0, 0.0, 0.0], r"action has shape \(.*3,?\); expected \(.*2,?\)"),
            (0.0, r"action has shape .*; expected"),
            ([0.0, math.nan], r"is nan; expected a finite number"),
            ([math.inf, 0.0], r"is inf; expected a finite number"),
            (["left", "right"], r"is not numeric"),
        ],
    )
    def test_actions(self, make, action, sentence):
        env = make()
        env.reset(seed=0)
        wide = [action] * 2 if isinstance(env, DeconflictionVectorEnv) else action
        with pytest.raises(error.InvalidAction, match=sentence):
            env.step(wide)
        # What was refused has changed nothing.
        env.step(np.zeros(env.action_space.shape))

    def test_step_before_reset(self, make):
        with pytest.raises(error.ResetNeeded, match="step was called before reset"):
            make().step(STRAIGHT)

    @pytest.mark.parametrize(
        ("options", "sentence"),
        [
            ({"scenario": "circel"}, r"scenario 'circel' is unknown; .*circle"),
            ({"scenario": 3}, r"scenario is 3; expected a name"),
            (
                {"encounters": 3},
                r"reset option 'encounters' is unknown; did you mean 'encounter'\?",
            ),
            ({"encounter": -1}, r"encounter number is -1; expected 0 or more"),
            ({"encounter": 1.5}, r"'encounter' is 1.5; expected a number or an Encounter"),
            (
                {"encounter": encounter(own=(0.0, 0.0, 0.0, 30.0))},
                r"own.speed is 30; expected within 50..100",
            ),
            (
                {"encounter": encounter(goal=(math.nan, 0.0))},
                r"goal_x is nan; expected a finite number",
            ),
            (
                {"encounter": encounter()._replace(mask=[False])},
                r"mask leaves an encounter without intruders",
            ),
            (
                {"encounter": encounter()._replace(goal_x=[1.0, 2.0, 3.0])},
                r"goal_x has shape \(3,\); expected",
            ),
            ({"encounter": encounter()._replace(goal_x="far")}, r"goal_x is not numeric"),
        ],
    )
    def test_options(self, make, options, sentence):
        with pytest.raises(EncounterError, match=sentence):
            make().reset(seed=0, options=options)

    def test_constructor(self, make):
        with pytest.raises(EncounterError, match="scenario 'spiral' is unknown"):
            make(scenario="spiral")
        with pytest.raises(
            EncounterError, match=r"rules.dt is 0.5 s; expected 1 s, the aircraft's time step"
        ):
            make(scenario="noisy", rules=RULES._replace(dt=0.5))
        with pytest.raises(error.UnsupportedMode, match="render_mode is 'ansi'"):
            make(render_mode="ansi")

    def test_seed(self, make):
        with pytest.raises(EncounterError, match=r"expected 0 <= seed < 2\*\*64"):
            make().reset(seed=2**64)


def test_bad_input_of_the_vector_environment_alone():
    with pytest.raises(ValueError, match="num_envs is 0; expected 1 or more"):
        DeconflictionVectorEnv(0)
    env = vector(2)
    with pytest.raises(EncounterError, match=r"seed is \[1, 2\]; expected one integer"):
        env.reset(seed=[1, 2])
    with pytest.raises(
        EncounterError, match="have 1 intruder columns; expected 8, as scenario 'multi'"
    ):
        env.reset(seed=0, options={"encounter": batch(encounter(), 2), "scenario": "multi"})
    env.close()
    with pytest.raises(error.ClosedEnvironmentError, match="closed; make a new one"):
        env.step(np.zeros((2, 2)))


def test_what_is_returned_belongs_to_the_caller():
    env = vector(2)
    observations, infos = env.reset(seed=0)
    copied = observations.copy()
    following, *_ = env.step(np.zeros((2, 2)))
    np.testing.assert_array_equal(observations, copied)
    following[:] = 0.0
    infos["min_separation"][:] = 0.0
    assert env.step(np.zeros((2, 2)))[4]["min_separation"].min() > 0.0
