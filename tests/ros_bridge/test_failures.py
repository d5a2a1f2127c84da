"""Errors of our own: said once, told until it has gone well, and never raised further."""

from typing import Any

from ros_bridge.core.failures import TOLD, Failures


def fail(*_: Any, **__: Any) -> Any:
    raise ValueError("operands could not be broadcast together")


def test_a_failure_is_said_once_and_told_until_it_has_gone_well_for_a_while():
    said: list[str] = []
    clock = [0.0]
    failures = Failures(said.append, lambda: clock[0])
    for _ in range(100):
        assert not failures.attempt("bands", fail)
    assert len(said) == 1 and failures.problems() == said
    assert said[0].startswith("bands failed: ValueError: operands could not be broadcast")
    assert "(test_failures.py, line " in said[0]
    clock[0] = 1_000.0  # as long as nothing was tried again it has not gone well
    assert failures.problems() == said
    assert not failures.attempt("bands", fail)
    assert failures.attempt("bands", lambda: None)
    clock[0] += TOLD
    assert failures.problems() == said
    clock[0] += 0.1
    assert failures.problems() == []
    assert not failures.attempt("bands", fail) and len(said) == 2
