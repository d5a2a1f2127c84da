"""Write the type stubs of ROS messages that stand beside this file: ``python typings/make.py``.

They describe all of ``rlcas_msgs``, and of other packages the messages that the sources import,
with the parts of those. The definitions of other packages are those that ``make ros`` installs. The
stubs of ``rclpy`` are written by hand. Tests compare all of them with what is installed
(tests/test_typings.py).
"""

import argparse
import ast
import re
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from mcap_ros2._vendor.rosidl_adapter import parser

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
OURS = ROOT / "ros_bridge" / "rlcas_msgs"
_SOURCES = "ros_bridge", "benchmarks"
_SUFFIXES = "msg", "srv"
_NOTE = "Written by typings/make.py."

_SCALARS = {
    "bool": "bool",
    "byte": "bytes",
    "char": "int",
    "float32": "float",
    "float64": "float",
    "string": "str",
    "wstring": "str",
} | {f"{sign}int{bits}": "int" for sign in ("", "u") for bits in (8, 16, 32, 64)}


class Kind(NamedTuple):
    """A message or a service, such as ``std_msgs``, ``msg``, ``Header``."""

    package: str
    folder: str
    name: str

    def file(self, share: Path) -> Path:
        """Return the file of its definition."""
        base = OURS.parent if self.package == OURS.name else share
        return base / self.package / self.folder / f"{self.name}.{self.folder}"


def stubs(share: Path | None) -> dict[str, str]:
    """Return the text of each file, by its path below this folder.

    Args:
        share: folder in which other packages keep their definitions; None: only the files of
            ``rlcas_msgs``.
    """
    classes: dict[Kind, list[str]] = {}
    waiting = list(ours()) + ([] if share is None else list(imported()))
    while waiting:
        kind = waiting.pop()
        if kind in classes or (share is None and kind.package != OURS.name):
            continue
        classes[kind], parts = _classes(kind, kind.file(share or ROOT))
        waiting += parts
    modules = {kind[:2] for kind in classes}
    return {f"{package}/__init__.pyi": f"# {_NOTE}\n" for package, _ in modules} | {
        f"{package}/{folder}/__init__.pyi": _module(
            [lines for kind, lines in sorted(classes.items()) if kind[:2] == (package, folder)]
        )
        for package, folder in modules
    }


def ours() -> Iterator[Kind]:
    """Yield the messages and services of ``rlcas_msgs``."""
    for suffix in _SUFFIXES:
        for file in OURS.glob(f"*/*.{suffix}"):
            yield Kind(OURS.name, suffix, file.stem)


def imported() -> Iterator[Kind]:
    """Yield the messages and services that the sources import."""
    for file in (file for name in _SOURCES for file in (ROOT / name).rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom):
                package, _, folder = (node.module or "").partition(".")
                if folder in _SUFFIXES:
                    yield from (Kind(package, folder, name.name) for name in node.names)


def _classes(kind: Kind, file: Path) -> tuple[list[str], list[Kind]]:
    """Return the lines of a kind's classes, and the kinds of its fields."""
    if kind.folder == "msg":
        message = parser.parse_message_file(kind.package, file)
        return _message(kind.name, kind.folder, message), _parts(message)
    service = parser.parse_service_file(kind.package, file)
    request = _message("Request", kind.folder, service.request)
    response = _message("Response", kind.folder, service.response)
    inner = [f"    {line}" if line else "" for line in (*request, "", *response)]
    return [f"class {kind.name}:", *inner], [*_parts(service.request), *_parts(service.response)]


def _parts(message: parser.MessageSpecification) -> list[Kind]:
    types = [field.type for field in message.fields]
    return [Kind(one.pkg_name, "msg", one.type) for one in types if one.pkg_name is not None]


def _message(name: str, folder: str, message: parser.MessageSpecification) -> list[str]:
    """Return the lines of a class: its constants, fields, and how it is made.

    A field of several values takes any sequence, and gives the type in which it is kept.
    """
    constants = [f"    {one.name}: ClassVar[{_SCALARS[one.type]}]" for one in message.constants]
    fields, arguments = [], []
    for field in message.fields:
        kept, taken = _types(field.type, f"{message.base_type.pkg_name}.{folder}")
        arguments.append(f"        {field.name}: {taken} = ...,")
        if kept == taken:
            fields.append(f"    {field.name}: {kept}")
        else:
            fields += ["    @property", f"    def {field.name}(self) -> {kept}: ..."]
            fields += [f"    @{field.name}.setter"]
            fields += [f"    def {field.name}(self, value: {taken}) -> None: ..."]
    if not arguments:
        return [f"class {name}:", *constants, "    def __init__(self) -> None: ..."]
    init = ["    def __init__(", "        self,", "        *,", *arguments, "    ) -> None: ..."]
    return [f"class {name}:", *constants, *fields, *init]


def _types(type_: parser.Type, module: str) -> tuple[str, str]:
    """Return in which type a field is kept, and which it takes, as ``module`` names them."""
    if type_.pkg_name is None:
        value = _SCALARS[type_.type]
    else:
        home = f"{type_.pkg_name}.msg"
        value = type_.type if home == module else f"{home}.{type_.type}"
    if not type_.is_array:
        return value, value
    if value not in {"int", "float"}:
        return f"list[{value}]", f"Sequence[{value}]"
    kept = "NDArray[Any]" if type_.is_fixed_size_array() else f"array[{value}]"
    return kept, f"Sequence[{value}] | NDArray[Any]"


def _module(classes: Sequence[Sequence[str]]) -> str:
    """Return the text of a module, with what it imports."""
    body = "\n\n".join("\n".join(lines) for lines in classes)
    typing = [name for name in ("Any", "ClassVar") if re.search(rf"\b{name}\b", body)]
    standard = [
        *(["from array import array"] if "array[" in body else []),
        *(["from collections.abc import Sequence"] if "Sequence[" in body else []),
        *([f"from typing import {', '.join(typing)}"] if typing else []),
    ]
    others = [f"import {name}" for name in sorted(set(re.findall(r"\b(\w+\.msg)\.\w", body)))]
    if "NDArray[" in body:
        others.append("from numpy.typing import NDArray")
    blocks = ["\n".join(lines) for lines in (standard, others) if lines]
    return "\n\n".join([f"# {_NOTE}", *blocks, body]) + "\n"


def main(arguments: Sequence[str] | None = None) -> None:
    """Write the files of the packages, and remove those of messages no longer in use."""
    options = argparse.ArgumentParser(prog="python typings/make.py", description=__doc__)
    share = Path(sys.prefix) / "share"
    options.add_argument(
        "--share", type=Path, default=share, help="where packages keep definitions (default: here)"
    )
    try:
        texts = stubs(options.parse_args(arguments).share)
    except FileNotFoundError as problem:
        options.error(f"{problem.filename} does not exist, expected the packages of 'make ros'")
    for file in HERE.rglob("*.pyi"):
        if file.read_text(encoding="utf-8").startswith(f"# {_NOTE}"):
            file.unlink()
    for name, text in texts.items():
        file = HERE / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
