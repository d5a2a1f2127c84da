"""Errors of our own: said once, told until it has gone well, and never raised further."""

from typing import Any

from ros_bridge.core.failures import TOLD, Failures


def fail(*_: Any, **__: Any) -> Any:
    raise ValueError("operands could not be broadcast together")


def test_a_failure_is_said_once_and_told_until_it_has_gone_well_for_a_while():
    lines: list[str] = []
    clock = [0.0]
    failures = Failures(lines.append, lambda: clock[0])
    for _ in range(100):
        assert not failures.attempt("bands", fail)
    assert len(lines) == 1 and failures.problems() == lines
    assert lines[0].startswith("bands failed: ValueError: operands could not be broadcast")
    assert "(test_failures.py, line " in lines[0]
    clock[0] = 1_000.0  # as long as nothing was tried again it has not gone well
    assert failures.problems() == lines
    assert not failures.attempt("bands", fail)
    assert failures.attempt("bands", lambda: None)
    clock[0] += TOLD
    assert failures.problems() == lines
    clock[0] += 0.1
    assert failures.problems() == []
    assert not failures.attempt("bands", fail) and len(lines) == 2
