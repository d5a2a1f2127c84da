"""The page that flies a policy in the browser: ``python docs/fly/make.py OUT`` writes it into a
folder, ready to open.

The site has it too: its hooks call :func:`weights`, so that it flies the policy that is shipped.
"""

import base64
import importlib
import io
import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from agents.config.load import load
from agents.config.world import AircraftConfig
from agents.policy.domain import check_domain
from agents.policy.file import PolicyFileError, read
from commands.command import Parser, run_cli

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
SHIPPED = ROOT / "agents" / "data" / "policy.safetensors"
AIRCRAFT = {
    "paper": "The paper's",
    "c208": "Cessna 208B",
    "light": "Light aircraft",
    "uas": "Small unmanned",
    "jet": "Transport jet",
}
"""Files of ``configs/aircraft`` by name, and what the page calls them."""
_VIEW = {"width": 1136, "height": 620}  # of the film, px; the panel on the left is not filmed
_STEPS, _EVERY = 2.0, 80  # time steps and ms from one picture of it to the next


def weights(path: Path = SHIPPED) -> str:
    """Return the script that holds the network of a policy file, and the aircraft to choose from.

    Raises:
        PolicyFileError: the file is refused, or its network is for one intruder.
        OutsideDomainError: the policy was not trained for one of the aircraft.
    """
    content = read(path)
    if not content.of_set:
        raise PolicyFileError(
            f"{path}: a policy for one intruder; expected one for any number (schema 2)"
        )
    aircraft = {
        name: load(AircraftConfig, ROOT / "configs" / "aircraft" / f"{name}.yaml").aircraft()
        for name in AIRCRAFT
    }
    for one in aircraft.values():
        check_domain(content, one)
    layers = content.metadata["architecture"]
    names = [f"each_{i}" for i in range(len(layers["encoder"]))] + [
        f"hidden_{i}" for i in range(len(layers["hidden"]))
    ]
    names.append("head")
    tensors = [content.actor[f"{name}/{part}"] for name in names for part in ("kernel", "bias")]
    document: dict[str, Any] = {
        "sha256": content.sha256,
        "most": layers["intruders"],
        "aircraft": {
            name: {**one._asdict(), "limits": one.limits._asdict(), "label": AIRCRAFT[name]}
            for name, one in aircraft.items()
        },
        "layers": [(name, *content.actor[f"{name}/kernel"].shape) for name in names],
        "data": base64.b64encode(
            b"".join(tensor.astype("<f4").tobytes() for tensor in tensors)
        ).decode("ascii"),
    }
    return f"const WEIGHTS = {json.dumps(document)};\n"


def write(folder: Path, path: Path = SHIPPED) -> Path:
    """Write the page with the policy of a file into a folder, and return its place."""
    script = weights(path)
    folder.mkdir(parents=True, exist_ok=True)
    for name in ("index.html", "fly.js", "policy.js", "search.js", "areas.js"):
        shutil.copyfile(HERE / name, folder / name)
    shutil.copyfile(ROOT / "commands" / "airmap.js", folder / "airmap.js")
    (folder / "weights.js").write_text(script, encoding="utf-8")
    return folder / "index.html"


def film(page_file: Path, out: Path) -> None:
    """Film eight aircraft of which each decides for itself, on a clock of the film's own, as an
    animated WebP.
    """
    image = importlib.import_module("PIL.Image")
    frames: list[Any] = []
    with importlib.import_module("playwright.sync_api").sync_playwright() as driver:
        browser = driver.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox"]
        )
        page = browser.new_page(viewport=_VIEW, reduced_motion="reduce")
        page.add_init_script(
            "let drawn = 9; Math.random = () => (drawn = (drawn * 16807) % 2147483647) / "
            "2147483647;"
        )
        page.goto(page_file.resolve().as_uri())
        page.check("[name=decides][value=all]", force=True)
        page.select_option("#scene", "sides")
        for button in ("#more", "#more", "#again", "#play"):
            page.click(button)
        page.evaluate("while (changed || !line.done) frame(last); play(true); playing = false;")
        steps = page.evaluate("line.frames.length")
        for moment in np.arange(0.0, steps - 1.0, _STEPS):
            page.evaluate("(moment) => { time = moment; shown = line; tell(draw()); }", moment)
            shot = page.screenshot(
                clip={
                    "x": 360.0,
                    "y": 16.0,
                    "width": _VIEW["width"] - 376.0,
                    "height": _VIEW["height"] - 32.0,
                }
            )
            frames.append(image.open(io.BytesIO(shot)).convert("RGB"))
        browser.close()
    durations = [_EVERY] * (len(frames) - 1) + [2_000]
    frames[0].save(
        out,
        save_all=True,
        append_images=frames[1:],
        duration=durations,
        loop=0,
        quality=60,
        method=3,
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Write what the command line asks for and return the exit status."""
    parser = Parser(prog="python docs/fly/make.py", description=__doc__)
    parser.add_argument(
        "out", type=Path, metavar="OUT", help="folder to write; files of these names are replaced"
    )
    parser.add_argument(
        "--policy",
        type=Path,
        metavar="FILE",
        default=SHIPPED,
        help="default: the one that is shipped",
    )
    parser.add_argument(
        "--film",
        type=Path,
        metavar="FILE.webp",
        help="film the page too (needs playwright, Chromium, Pillow)",
    )
    options = parser.parse_args(arguments)
    page_file = write(options.out, options.policy)
    if options.film is not None:
        film(page_file, options.film)
    print(options.film or page_file)
    return 0


if __name__ == "__main__":
    run_cli(main)
