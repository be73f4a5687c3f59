"""Check the prose of Python: docstrings, strings below fields, and comments.

    python -m tests.prose_code                       every module that is checked
    python -m tests.prose_code missions/geo/*.py     these modules

The words are those of `tests.prose`; a docstring begins with a verb or a noun as well.
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

from tests import prose
from tests.prose import ROOT, Fault

_BEGINS: Final = re.compile(r"(?:Who|What|How|Where|Whether|Why|Nothing|Nobody)\b")
_ITEM: Final = re.compile(r"\s*(?:[*-] |\d+\. |\w+(?:, \w+)*: )")
_ENTRY: Final = re.compile(r"\s+\w+(?:, \w+)*: ")
"""A name in a list of arguments or attributes, which is code."""
_PRAGMA: Final = re.compile(r"# ?(?:noqa|type:|pragma|fmt:|---|===|mypy:|ruff:|!)")


def docstrings(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield the strings that stand alone as statements, with their lines."""
    for node in ast.walk(tree):
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
    found = []
    for line, docstring in docstrings(ast.parse(source)):
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
    "uavmap/*.py",
    *(f"uavmap/{folder}/**/*.py" for folder in (
        "aircraft", "base", "fleet", "journal", "lab", "mavlink", "photos", "runner", "ui/api",
        "ui/app", "ui/cli", "ui/ground", "ui/page", "ui/tak",
    )),
    "vision/**/*.py",
)  # fmt: skip
"""Modules that are checked, as patterns."""


def checked() -> list[Path]:
    """Return the modules that are checked."""
    return sorted({path for pattern in CHECKED for path in ROOT.glob(pattern)})


def main(names: Iterable[str]) -> int:
    """Print every fault; return 1 if there is one."""
    paths = [Path(name).resolve() for name in names] or checked()
    lines = prose.fault_lines(paths, lambda path: source_faults(path.read_text("utf-8")))
    print("\n".join(lines) if lines else f"prose: {len(paths)} modules without a fault")
    return 1 if lines else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
