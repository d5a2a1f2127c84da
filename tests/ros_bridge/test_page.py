"""The node on the page about ROS graphs of one's own runs, and the runner answers it as the page says."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.ros_bridge.graph import ROOT, Process, domain

PAGE = (ROOT / "docs" / "howto" / "own-ros-graph.md").read_text(encoding="utf-8")
PROGRAM = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)[0]
PRINTED = re.findall(r"```text\n(.*?)```", PAGE, re.DOTALL)
OWN = '        self.own.publish(aircraft("own", now, 80.0 * seconds, 80.0))\n'


@pytest.mark.slow
@pytest.mark.parametrize(("left_out", "printed"), [("", PRINTED[0]), (OWN, PRINTED[1])], ids=["whole", "no ownship"])
def test_the_program_of_the_page_gets_the_answers_of_the_page(left_out: str, printed: str, tmp_path: Path) -> None:
    assert left_out in PROGRAM
    (tmp_path / "ask.py").write_text(PROGRAM.replace(left_out, "") if left_out else PROGRAM, encoding="utf-8")
    with domain() as number:
        Process("ros_bridge.runner", number)
        environment = os.environ | {
            "ROS_DOMAIN_ID": str(number),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "PYTHONPATH": str(ROOT),
        }
        done = subprocess.run(
            [sys.executable, "ask.py"],
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
    assert done.returncode == 0, done.stderr
    # Some metres depend on when the request is made.
    assert re.sub(r"\d+ m ", "m ", done.stdout) == re.sub(r"\d+ m ", "m ", printed)
