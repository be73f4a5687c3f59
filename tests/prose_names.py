"""Check the names that Python modules define: functions, methods, classes and constants.

    python -m tests.prose_names                       the product's modules of `tests.prose_code`
    python -m tests.prose_names missions/geo/*.py     these modules

Names of fields stay, because files and missions hold them; so do names within a function.
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final

from tests import prose_code
from tests.prose import ROOT, Fault, fault_lines

_ALONE: Final = {"take": "add, receive", "of": "from_rings, parse"}
"""Names that no function has by themselves, each with better ones."""
_SPOKEN: Final = re.compile(
    "(?:un)?(?:told|said|heard)|(?:tell|say|hear|wish|wishe|everyone|nobody)s?|who"
    "|(?:some|any|every)body|vain"
)
"""Words that no name has."""
_PARTICIPLES: Final = re.compile("Asked|Flown|Found|Given|Known|Looked|Seen|Shown|Taken|Wanted")
"""Classes that do not name the thing."""
_LIMITS: Final = re.compile("(MOST|LEAST)_")
"""Constants that the house begins with `MAX_` and `MIN_`."""
_ACTS: Final = re.compile(
    "[a-z]+(?<!e)ed|done|flown|found|given|known|left|lost|met|sent|shown|taken"
)
"""Functions that return nothing and do not say what they do."""
_WORD: Final = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])")


def defined(body: Iterable[ast.stmt], *, fields: bool = False) -> Iterator[tuple[str, ast.stmt]]:
    """Yield the names that a module defines, with the methods of its classes.

    Args:
        body: statements of a module or a class.
        fields: True to leave out assigned names, which are fields of a class.
    """
    for node in body:
        match node:
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name):
                yield name, node
            case ast.ClassDef(name=name):
                yield name, node
                yield from defined(node.body, fields=True)
            case ast.AnnAssign(target=ast.Name(id=name)) | ast.Assign(targets=[ast.Name(id=name)]):
                if not fields:
                    yield name, node
            case ast.If(body=first, orelse=second):
                yield from defined([*first, *second], fields=fields)


def _returns_nothing(node: ast.stmt) -> bool:
    match node:
        case ast.FunctionDef(returns=returns) | ast.AsyncFunctionDef(returns=returns):
            return isinstance(returns, ast.Constant) and returns.value is None
    return False


def name_faults(source: str) -> list[Fault]:
    """Return what is wrong with the names that a module defines."""
    found = []
    for name, node in defined(ast.parse(source).body):
        plain = name.strip("_")
        if plain in _ALONE:
            found.append(Fault(node.lineno, f"{name}: write what it does, as {_ALONE[plain]}"))
        for word in _WORD.findall(plain):
            if _SPOKEN.fullmatch(word.lower()):
                found.append(Fault(node.lineno, f"{name}: write it without {word!r}"))
        if isinstance(node, ast.ClassDef) and _PARTICIPLES.fullmatch(plain):
            found.append(Fault(node.lineno, f"{name}: name the thing"))
        if match := _LIMITS.match(plain):
            found.append(Fault(node.lineno, f"{name}: write MAX_ or MIN_ for {match[0]}"))
        if _returns_nothing(node) and _ACTS.fullmatch(plain):
            found.append(Fault(node.lineno, f"{name}: write what it does, as note_{plain}"))
    return found


def checked() -> list[Path]:
    """Return the modules that are checked."""
    return [p for p in prose_code.checked() if p.relative_to(ROOT).parts[0] in prose_code.PRODUCT]


def main(names: Iterable[str]) -> int:
    """Print every fault; return 1 if there is one."""
    paths = [Path(name).resolve() for name in names] or checked()
    lines = fault_lines(paths, lambda path: name_faults(path.read_text("utf-8")))
    print("\n".join(lines) if lines else f"names: {len(paths)} modules without a fault")
    return 1 if lines else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
