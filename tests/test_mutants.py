"""Every mutant is still one change of the code, and the command tells which survive."""

import ast
from pathlib import Path

import pytest

from tests.mutants import check, kernel, monitor
from tests.mutants.__main__ import outcome
from tests.mutants.mutant import ROOT, Mutant, mutated


@pytest.mark.parametrize(
    "mutants",
    [check.MUTANTS, kernel.MUTANTS, monitor.MUTANTS],
    ids=["check", "kernel", "monitor"],
)
def test_mutants_are_changes_that_parse(mutants: tuple[Mutant, ...]) -> None:
    assert len(set(mutants)) == len(mutants)
    for mutant in mutants:
        source = (ROOT / mutant.file).read_text(encoding="utf-8")
        assert mutated(mutant, source) != source
        ast.parse(mutated(mutant, source))
        assert all((ROOT / test).is_file() for test in mutant.tests)


@pytest.mark.slow
def test_a_mutant_that_no_test_notices_survives(tmp_path: Path) -> None:
    (tmp_path / "arithmetic.py").write_text("def least():\n    return 1\n")
    test = "from arithmetic import least\ndef test():\n    assert least() {} 1\n"
    for name, relation in (("strict", "=="), ("lax", "<=")):
        (tmp_path / f"test_{name}.py").write_text(test.format(relation))
    (tmp_path / "pytest.ini").write_text("[pytest]\npythonpath = .\n")
    mutant = Mutant("arithmetic.py", "return 1", "return 0", ("test_strict.py",))
    assert outcome(mutant, tmp_path) == "killed"
    assert outcome(mutant._replace(tests=("test_lax.py",)), tmp_path) == "SURVIVED"
    assert outcome(mutant._replace(replacement="return"), tmp_path) == "killed"
    assert outcome(mutant._replace(replacement="return ("), tmp_path) == "BROKEN"
    assert (tmp_path / "arithmetic.py").read_text() == "def least():\n    return 1\n"
    with pytest.raises(ValueError, match="stands there 0 times"):
        outcome(mutant._replace(text="nothing"), tmp_path)
