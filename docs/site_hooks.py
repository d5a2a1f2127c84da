"""What the documentation site adds to the pages of ``docs/``: hooks of mkdocs, named in
``mkdocs.yml``.

- A page for every module with public names, which mkdocstrings fills from the sources without
  importing them.
- A page for every text file outside ``docs/`` that is linked to, so that the link holds on the site
  as in a checkout.
- A contents page for every folder that is linked to, or stands in ``nav``, and has none.
- In ``nav`` a folder stands for all its pages.
- The numbers of the shipped policy, and the drawing code of all pages, for the page that flies it
  (``docs/fly/make.py``).
- Roles of our docstrings (``:func:`size```) are links, and double backticks code: an extension of
  griffe.
- A comment on the line of a class's annotated field is the field's text where it has no docstring:
  another one.

A link to what does not exist is left as it is, so that the strict build refuses it.
"""

import ast
import io
import posixpath
import re
import runpy
import tokenize
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import griffe
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

PACKAGES = ("commands", "envs", "agents", "rlcas_jax", "eval", "ros_bridge")
OUTSIDE = "repository"
"""Folder of the site for what lies outside ``docs/``."""
ALWAYS_OUTSIDE = ("CHANGELOG.md", "CONTRIBUTING.md", "README.md")
"""Files outside ``docs/`` that the site holds even where nothing links to them."""

_LINK = re.compile(r"(?<=\]\()(?![a-z]+:|[#/<])([^)\s#]+)((?:#[^)\s]*)?)(?=\))")
_ROLE = re.compile(r":[a-z]+:(?=`)")
_NAMED_ROLE = re.compile(r":(?:attr|class|data|exc|func|meth|mod):`~?([\w.]+)`")
_FOR_TOOLS = re.compile(r"noqa\b|pyright:|type:|fmt:")
_LANGUAGES = {".csv": "text", ".py": "python", ".toml": "toml", ".yaml": "yaml", ".yml": "yaml"}


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that are made, and write the folders of ``nav`` out."""
    docs = Path(config.docs_dir)
    for name, text in _code(docs.parent):
        files.append(File.generated(config, name, content=text))
    weights = runpy.run_path(str(docs / "fly" / "make.py"))["weights"]()
    files.append(File.generated(config, "fly/weights.js", content=weights))
    drawing = (docs.parent / "commands" / "airmap.js").read_text(encoding="utf-8")
    files.append(File.generated(config, "fly/airmap.js", content=drawing))
    waiting = [docs.parent / name for name in ALWAYS_OUTSIDE]
    for file in files.documentation_pages():
        waiting += _links_outside(file.content_string, docs / file.src_uri, docs)
    while waiting:
        path = waiting.pop()
        if files.get_file_from_path(_uri(path, docs)) is None:
            text = _as_page(path, docs)
            files.append(File.generated(config, _uri(path, docs), content=text))
            waiting += _links_outside(text, path, docs)
    for folder in sorted(_folders(files, docs) | set(_folders_of(config.nav)), reverse=True):
        if files.get_file_from_path(f"{folder}/README.md") is None:
            files.append(
                File.generated(config, f"{folder}/README.md", content=_contents(folder, files))
            )
    config.nav = _expand_folders(config.nav, files)
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Turn links to files outside ``docs/``, and to folders, into links to their pages."""
    docs = Path(config.docs_dir)
    here = page.file.src_uri
    inside, outside = docs / here, docs.parent / here.removeprefix(f"{OUTSIDE}/")
    origin = outside if here.startswith(f"{OUTSIDE}/") else inside

    def relative(link: re.Match[str]) -> str:
        uri = _uri(_target(link[1], origin), docs)
        for known in (uri, f"{uri}/README.md"):
            if uri != "." and files.get_file_from_path(known) is not None:
                return posixpath.relpath(known, posixpath.dirname(here)) + link[2]
        return link[0]

    return _LINK.sub(relative, markdown)


def _code(root: Path) -> Iterator[tuple[str, str]]:
    """Give name and text of a page for each module with public names, and for each package."""
    for package in PACKAGES:
        rows: dict[Path, list[str]] = {}
        for path in sorted((root / package).rglob("*.py")):
            if "." in path.stem:  # a launch file, which nobody imports
                continue
            tree = ast.parse(path.read_text(encoding="utf-8"))
            module = ".".join(path.relative_to(root).with_suffix("").parts)
            summary = (ast.get_docstring(tree) or "").split("\n\n")[0].replace("\n", " ")
            summary = _ROLE.sub("", summary).replace("|", r"\|")
            if path.name == "__init__.py":
                rows.setdefault(path.parent, []).insert(
                    0, f"{summary}\n\n| module | what it is |\n|---|---|\n"
                )
            elif _has_public_names(tree):
                rows.setdefault(path.parent, []).append(
                    f"| [`{module}`]({path.stem}.md) | {summary} |\n"
                )
                yield (
                    f"reference/code/{module.replace('.', '/')}.md",
                    f"---\ntitle: {path.stem}\n---\n\n::: {module}\n",
                )
        for folder, lines in rows.items():
            if len(lines) > 1:
                name = folder.relative_to(root).as_posix()
                module = name.replace("/", ".")  # also the heading's id: what a role links to
                yield (
                    f"reference/code/{name}/README.md",
                    f"# {module} {{ #{module} }}\n\n{''.join(lines)}",
                )


def _has_public_names(tree: ast.Module) -> bool:
    """Return whether a module has public functions or classes, or constants that a text below
    describes.
    """
    described = zip(tree.body, tree.body[1:], strict=False)
    return any(
        isinstance(node, ast.FunctionDef | ast.ClassDef) and node.name[0] != "_"
        for node in tree.body
    ) or any(
        isinstance(node, ast.Assign | ast.AnnAssign) and ast.unparse(text)[0] in "'\""
        for node, text in described
    )


def _target(link: str, origin: Path) -> Path:
    return Path(posixpath.normpath(posixpath.join(origin.parent.as_posix(), link)))


def _links_outside(text: str, origin: Path, docs: Path) -> list[Path]:
    """Return the files of the repository, but outside ``docs/``, that a page links to."""
    targets = (_target(link[1], origin) for link in _LINK.finditer(text))
    return [
        path
        for path in targets
        if path.is_relative_to(docs.parent) and not path.is_relative_to(docs) and path.is_file()
    ]


def _uri(path: Path, docs: Path) -> str:
    """Return the page, as a path below ``docs/``, of a file of the repository."""
    if path.is_relative_to(docs):
        return path.relative_to(docs).as_posix()
    if not path.is_relative_to(docs.parent):
        return "."
    uri = f"{OUTSIDE}/{path.relative_to(docs.parent).as_posix()}"
    return uri if path.suffix == ".md" or not path.is_file() else f"{uri}.md"


def _as_page(path: Path, docs: Path) -> str:
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".md":
        return text
    name = path.relative_to(docs.parent).as_posix()
    return f"# `{name}`\n\n~~~~~~~~ {_LANGUAGES.get(path.suffix, 'text')}\n{text}\n~~~~~~~~\n"


def _folders(files: Files, docs: Path) -> set[str]:
    """Return the folders below ``docs/`` that pages link to."""
    targets = {
        _target(link[1], docs / file.src_uri)
        for file in files.documentation_pages()
        for link in _LINK.finditer(file.content_string)
    }
    return {
        path.relative_to(docs).as_posix()
        for path in targets
        if path.is_relative_to(docs) and path.is_dir()
    }


def _folders_of(nav: Any) -> Iterator[str]:
    """Give the folders that stand in ``nav``."""
    for entry in nav.values() if isinstance(nav, dict) else nav if isinstance(nav, list) else ():
        if isinstance(entry, str) and entry.endswith("/"):
            yield entry.removesuffix("/")
        yield from _folders_of(entry)


def _contents(folder: str, files: Files) -> str:
    """Return a page that lists what is in a folder: pages by their title, files by their name."""
    lines = []
    for file in sorted(files, key=lambda file: file.src_uri):
        rest = file.src_uri.removeprefix(f"{folder}/")
        if (
            rest == file.src_uri
            or rest.count("/") > 1
            or ("/" in rest and not rest.endswith("/README.md"))
        ):
            continue
        lines.append(f"- [{_title(file) if file.is_documentation_page() else rest}]({rest})\n")
    return f"# {folder.rsplit('/', 1)[-1].capitalize()}\n\n{''.join(lines)}"


def _title(file: File) -> str:
    found = re.search(r"^# (.+)$", file.content_string, re.MULTILINE)
    return found[1] if found else file.name


def _expand_folders(nav: Any, files: Files) -> Any:
    """Return ``nav`` with its folders replaced by their pages."""
    if isinstance(nav, list):
        return [_expand_folders(entry, files) for entry in nav]
    if isinstance(nav, dict):
        return {title: _expand_folders(entry, files) for title, entry in nav.items()}
    return _pages(nav, files) if isinstance(nav, str) and nav.endswith("/") else nav


def _pages(folder: str, files: Files) -> list[Any]:
    below = sorted(f.src_uri for f in files.documentation_pages() if f.src_uri.startswith(folder))
    here = [uri for uri in below if "/" not in uri.removeprefix(folder)]
    folders = sorted(
        {uri.removeprefix(folder).split("/")[0] for uri in below}
        - {posixpath.basename(u) for u in here}
    )
    index = f"{folder}README.md"
    entries: list[Any] = sorted(here, key=lambda uri: (uri != index, uri))
    return entries + [{name: _pages(f"{folder}{name}/", files)} for name in folders]


class FieldComments(griffe.Extension):
    """Takes the comment behind an annotated field of a class for its docstring, where it
    has none.
    """

    def on_module_node(self, *, node: Any, agent: Any, **_: Any) -> None:
        """Read the comments of a module before its fields, because its syntax tree has none."""
        tokens = tokenize.generate_tokens(io.StringIO(agent.code).readline)
        self._comments = {
            each.start[0]: each.string[1:].strip()
            for each in tokens
            if each.type == tokenize.COMMENT
        }

    def on_attribute_instance(
        self, *, node: Any, attr: griffe.Attribute, agent: Any, **_: Any
    ) -> None:
        """Give a field its text."""
        if attr.docstring is None and isinstance(node, ast.AnnAssign) and agent.current.is_class:
            text = self._comments.get(node.end_lineno, "")
            if text and not _FOR_TOOLS.match(text):
                attr.docstring = griffe.Docstring(
                    text,
                    lineno=node.end_lineno,
                    endlineno=node.end_lineno,
                    parent=attr,
                    parser=agent.docstring_parser,
                    parser_options=agent.docstring_options,
                )


class Roles(griffe.Extension):
    """Rewrites docstrings before they are parsed."""

    def on_package(self, *, pkg: griffe.Module, **_: Any) -> None:
        """Rewrite every docstring of a package, when all its names are known."""
        _rewrite(pkg)


def _rewrite(item: griffe.Object) -> None:
    if item.docstring is not None:
        scope = item
        item.docstring.value = _NAMED_ROLE.sub(
            lambda role: _reference(role[1], scope), item.docstring.value
        )
    for member in item.members.values():
        if not member.is_alias:
            _rewrite(member)  # pyright: ignore[reportArgumentType]


def _reference(name: str, scope: griffe.Object) -> str:
    """Return a link to a public name where there is one, else the name as code."""
    try:
        first, _, rest = name.partition(".")
        path = scope.resolve(first) + (f".{rest}" if rest else "")
    except griffe.NameResolutionError:
        path = name
    try:
        found = scope.modules_collection[path]
    except KeyError:
        return f"`{name}`"
    return f"[`{name}`][{path}]" if found.is_public else f"`{name}`"
