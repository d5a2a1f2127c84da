"""The checker of certificates and the attack's judge, which samples, agree."""

import copy
import json
from typing import Any

import numpy as np
import pytest

from agents import check
from agents.inference import Policy
from agents.planner import Intruder, plan
from agents.planner.request.request import Altitude
from benchmarks.safety.judgement import wrong
from benchmarks.safety.mutation import mutate
from envs.kinematics import VehicleState
from tests.agents.certificates import HEIGHT, OWN, ROUTE, certificate, is_accepted, refusal
from tests.agents.scenes import PATIENT


@pytest.fixture(scope="module")
def data() -> dict[str, Any]:
    return certificate()


@pytest.mark.parametrize(("field", "change"), [(0, 20.0), (1, 1.0), (2, 0.01), (3, 1.0), (4, 0.5)])
def test_an_intruder_reported_nearer_is_refused(
    data: dict[str, Any], field: int, change: float
) -> None:
    # The bound is exact: of more and less one leads nearer than it, on whichever side the plan
    # passes.
    edited = [copy.deepcopy(data), copy.deepcopy(data)]
    for one, sign in zip(edited, (1.0, -1.0), strict=True):
        one["intruders"][0][field] += sign * change
    faults = wrong(edited)
    assert "distance" in faults
    for one, fault in zip(edited, faults, strict=True):
        if fault:
            assert "intruder 0" in refusal(one)


def test_an_intruder_close_by_but_above_at_the_request_is_accepted() -> None:
    """It counts from 100 s on; at the request it is nearer than the separation."""
    above = Altitude(HEIGHT.value + 800.0, "msl", -2.0)
    near = Intruder(VehicleState(-300.0, 200.0, 2.5, 70.0), altitude=above)
    answer = plan(OWN, [near], ROUTE, Policy.load(), PATIENT, own_altitude=HEIGHT)
    assert answer.safe and answer.windows[0].begin == pytest.approx(100.0, abs=1.0)
    data = json.loads(answer.certificate or b"")
    check.accept(data)
    assert wrong([data]) == [""]
    data["apart"][0][1] = 5.0
    assert refusal(data).startswith("intruder 0 may come too close before")
    assert wrong([data]) != [""]


def test_checker_refuses_what_sampling_finds_wrong(data: dict[str, Any]) -> None:
    changed = [mutate(data, np.random.default_rng([4, number])) for number in range(40)]
    faults = wrong([one for one, _ in changed])
    accepted = set[str]()
    for (one, kind), fault in zip(changed, faults, strict=True):
        if fault:
            assert refusal(one), (kind, fault)
        elif is_accepted(one):
            accepted.add(kind)
    assert sum(map(bool, faults)) >= 10
    assert (
        "approach" in accepted
    )  # what is refused is so for what it says, not for how it is written
    assert wrong([data]) == [""]


def test_what_is_accepted_with_an_edited_byte_is_still_right(data: dict[str, Any]) -> None:
    rng, text = np.random.default_rng(8), json.dumps(data)
    digits = [
        place for place, character in enumerate(text) if character.isdigit() or character in "-.,e"
    ]
    accepted = []
    for place in rng.choice(digits, 50, replace=False).tolist():
        byte = "0123456789-.,e"[int(rng.integers(14))]
        try:
            changed = json.loads(text[:place] + byte + text[place + 1 :])
            check.accept(changed)
        except (ValueError, ArithmeticError):
            continue
        accepted.append(changed)
    assert 5 <= len(accepted) <= 45
    assert not any(wrong(accepted))
