"""The type stubs of ROS in ``typings`` say what an installed ROS says."""

import ast
import importlib
import inspect
import runpy
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

TYPINGS = Path(__file__).resolve().parents[1] / "typings"
MAKE = runpy.run_path(str(TYPINGS / "make.py"))
GENERATED = {
    file.relative_to(TYPINGS).as_posix(): text
    for file in TYPINGS.rglob("*.pyi")
    if (text := file.read_text(encoding="utf-8")).startswith(f"# {MAKE['_NOTE']}")
}
BY_HAND = sorted(
    file for file in TYPINGS.rglob("*.pyi") if file.relative_to(TYPINGS).as_posix() not in GENERATED
)
AGAIN = "run python typings/make.py"


def _module(file: Path) -> Any:
    """Import the module that a stub describes, or pass the test over where it is not installed."""
    name = ".".join(file.relative_to(TYPINGS).with_suffix("").parts).removesuffix(".__init__")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of the library that parses interfaces
        pytest.importorskip("rclpy", reason="ROS 2 is not installed; to have it: make ros")
        return importlib.import_module(name)


def _classes(tree: ast.Module, module: Any) -> Iterator[tuple[ast.ClassDef, Any]]:
    """Yield the classes of a stub, also those inside others, with what is installed."""
    waiting: list[tuple[ast.stmt, Any]] = [(node, module) for node in tree.body]
    while waiting:
        node, home = waiting.pop()
        if isinstance(node, ast.ClassDef):
            real = getattr(home, node.name)
            yield node, real
            waiting += [(inner, real) for inner in node.body]


def _refused_calls(stub: ast.FunctionDef, real: Any) -> Iterator[str]:
    """Yield the calls, with everything and with what is required, that a stub allows alone."""
    by_place = [one.arg for one in stub.args.args]
    by_name = [one.arg for one in stub.args.kwonlyargs]
    required = [
        name
        for name, default in zip(by_name, stub.args.kw_defaults, strict=True)
        if default is None
    ]
    least = by_place[: len(by_place) - len(stub.args.defaults)]
    for places, names in ((by_place, by_name), (least, required)):
        try:
            inspect.signature(real).bind(*places, **dict.fromkeys(names))
        except TypeError as problem:
            yield f"{stub.name}: {problem}"


def test_the_stubs_of_our_messages_are_those_of_their_definitions():
    ours = MAKE["stubs"](None)
    assert "rlcas_msgs/srv/__init__.pyi" in ours
    changed = [name for name, text in ours.items() if GENERATED.get(name) != text]
    assert not changed, AGAIN


def test_the_stubs_of_messages_are_those_of_the_installed_definitions():
    _module(TYPINGS / "rclpy" / "__init__.pyi")
    written = MAKE["stubs"](Path(sys.prefix) / "share")
    assert {
        name for name in GENERATED.keys() | written if GENERATED.get(name) != written.get(name)
    } == set(), AGAIN


@pytest.mark.parametrize("name", sorted(name for name in GENERATED if name.count("/") > 1))
def test_a_message_has_the_fields_and_constants_of_its_stub(name):
    module = _module(TYPINGS / name)
    for stub, real in _classes(ast.parse(GENERATED[name]), module):
        init = [
            node
            for node in stub.body
            if isinstance(node, ast.FunctionDef) and node.name == "__init__"
        ]
        for node in init:  # a service holds classes alone
            fields = set(real.get_fields_and_field_types()) - {
                "structure_needs_at_least_one_member"
            }
            assert {one.arg for one in node.args.kwonlyargs} == fields, stub.name
        constants = [node.target.id for node in stub.body if isinstance(node, ast.AnnAssign)]
        assert [one for one in constants if not hasattr(real, one)] == [], stub.name


@pytest.mark.parametrize("file", BY_HAND, ids=lambda file: file.relative_to(TYPINGS).as_posix())
def test_what_is_installed_has_the_names_and_takes_the_calls_of_a_stub_by_hand(file):
    tree, module = ast.parse(file.read_text(encoding="utf-8")), _module(file)
    for stub, real in [(tree, module), *_classes(tree, module)]:
        for node in stub.body:
            if isinstance(node, ast.FunctionDef):
                given = getattr(real, node.name)
                if not node.decorator_list:  # no property
                    assert list(_refused_calls(node, given)) == []
            elif isinstance(node, ast.Assign | ast.AnnAssign):
                target = node.targets[0] if isinstance(node, ast.Assign) else node.target
                name = target.id
                assert name.startswith("_") or hasattr(real, name), name
