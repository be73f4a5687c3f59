"""Check the prose of code: docstrings, comments, names of tests, and texts that the product shows.

    python -m tests.prose_code                       every module and page that is checked
    python -m tests.prose_code missions/geo/*.py     these modules

The words are those of `tests.prose`; a docstring begins with a verb or a noun as well. The name of
a test begins with its subject: `test_guardian_pilot_selects_land_stops_sending`.
"""

from __future__ import annotations

import ast
import inspect
import io
import re
import sys
import tokenize
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final

from tests import prose, prose_texts
from tests.prose import ROOT, Fault

_BEGINS: Final = re.compile(r"(?:Who|What|How|Where|Whether|Why|Nothing|Nobody)\b")
_ITEM: Final = re.compile(r"\s*(?:[*-] |\d+\. |\w+(?:, \w+)*: )")
_ENTRY: Final = re.compile(r"\s+\w+(?:, \w+)*: ")
"""A name in a list of arguments or attributes, which is code."""
_NO_SUBJECT: Final = re.compile(
    r"(?<=test_)(?:above|after|at|before|below|beside|by|from|if|in|it|its|of|on|one_that|over|that|"
    r"there|these|they|this|those|to|when|where|while|with|without|nothing|whatever)(?=_)"
)
_NAME: Final = re.compile(
    r"(?<=_)(?:who|whom|whoever|nobody|somebody|everybody|anybody|what|tells?|told|says?|said|"
    r"hears?|heard|so_long|so_many|taken_up|in_vain|pressing)(?=_|$)"
)
_PRAGMA: Final = re.compile(r"# ?(?:noqa|type:|pragma|fmt:|---|===|mypy:|ruff:|!)")


def statements(tree: ast.AST) -> Iterator[ast.AST]:
    """Yield the statements of a module, at every depth."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.stmt | ast.excepthandler | ast.match_case):
            yield node
            yield from statements(node)


def docstrings(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield the strings that stand alone as statements, with their lines."""
    for node in statements(tree):
        value = node.value if isinstance(node, ast.Expr) else None
        if isinstance(value, ast.Constant) and isinstance(value.value, str):
            yield value.lineno, value.value


def comments(source: str) -> Iterator[tuple[int, str]]:
    """Yield comments with their lines; comments below each other are one text."""
    last, begun, gathered = (0, 0), 0, list[str]()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type != tokenize.COMMENT or _PRAGMA.match(token.string):
            continue
        if gathered and token.start != (last[0] + 1, last[1]):
            yield begun, " ".join(gathered)
            gathered = []
        begun, last = begun if gathered else token.start[0], token.start
        gathered.append(token.string.lstrip("# "))
    if gathered:
        yield begun, " ".join(gathered)


def names_of_tests(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield the names of tests with their lines."""
    for node in statements(tree):
        match node:
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name):
                if name.startswith("test_"):
                    yield node.lineno, name


def paragraphs(docstring: str) -> Iterator[str]:
    """Yield paragraphs and points of a docstring, without code."""
    for block in re.split(r"\n\s*\n", inspect.cleandoc(docstring)):
        lines = block.splitlines()
        if any(line.lstrip().startswith(">>>") for line in lines) or (
            all(line.startswith("    ") for line in lines) and not _ITEM.match(lines[0])
        ):
            continue
        part = list[str]()
        for line in lines:
            if part and (_ITEM.match(line) or part[-1].endswith(":")):
                yield " ".join(part)
                part = []
            name = _ENTRY.match(line)
            part.append(line[name.end() :] if name else line.strip())
        yield " ".join(part)


def source_faults(source: str) -> list[Fault]:
    """Return what is wrong with the prose of a module."""
    found, tree = [], ast.parse(source)
    for line, name in names_of_tests(tree):
        if match := _NO_SUBJECT.match(name, 5) or _NAME.search(name):
            found.append(Fault(line, f"{match[0]!r} in {name}: name subject, condition, outcome"))
    for line, docstring in docstrings(tree):
        if match := _BEGINS.match(docstring):
            found.append(Fault(line, f"begins with {match[0]!r}: begin with a verb or a noun"))
        found += [
            Fault(line, what) for text in paragraphs(docstring) for what in prose.faults(text)
        ]
    found += [Fault(line, what) for line, text in comments(source) for what in prose.faults(text)]
    return sorted(set(found))


CHECKED: Final = (
    "examples/*.py",
    "missions/**/*.py",
    "packaging/*.py",
    "sitl/**/*.py",
    "tests/*/**/*.py",
    "uavmap/*.py",
    *(f"uavmap/{folder}/**/*.py" for folder in (
        "aircraft", "base", "fleet", "journal", "lab", "load", "mavlink", "output", "photos",
        "runner", "ui/api", "ui/app", "ui/cli", "ui/ground", "ui/page", "ui/tak",
    )),
    "vision/**/*.py",
)  # fmt: skip
"""Modules that are checked, as patterns."""
PRODUCT: Final = ("missions", "sitl", "uavmap", "vision")
"""Folders whose strings are checked, with their scripts and pages."""


def checked() -> list[Path]:
    """Return the modules that are checked."""
    return sorted({path for pattern in CHECKED for path in ROOT.glob(pattern)})


def pages() -> list[Path]:
    """Return the scripts and pages of the product."""
    return sorted(
        path
        for folder in PRODUCT
        for path in (ROOT / folder).rglob("*.[jh]*")
        if path.suffix in (".js", ".html")
    )


def file_faults(path: Path) -> list[Fault]:
    """Return what is wrong with the prose of a module, a script or a page."""
    source = path.read_text("utf-8")
    found = source_faults(source) if path.suffix == ".py" else []
    if path.relative_to(ROOT).parts[0] in PRODUCT:
        found += [
            Fault(line, what)
            for line, text in prose_texts.shown(path.name, source)
            for what in prose_texts.faults(text)
        ]
    return sorted(set(found))


def main(names: Iterable[str]) -> int:
    """Print every fault; return 1 if there is one."""
    paths = [Path(name).resolve() for name in names] or [*checked(), *pages()]
    lines = prose.fault_lines(paths, file_faults)
    print("\n".join(lines) if lines else f"prose: {len(paths)} modules and pages without a fault")
    return 1 if lines else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
