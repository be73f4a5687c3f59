"""Find the texts that a program shows in its code: strings of Python, of scripts and of pages.

A text has two words or more. A value that is put into it is one word. Lines of examples and of
tables are left out: they are indented, or have columns.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable, Iterator
from typing import Final

from tests import prose

_VALUE: Final = "N"
"""The word for a value that is put into a text."""
_SHOWN: Final = re.compile(r"[^\W\d_]{2,}\W* (?:.*\W)?[^\W\d_]{2,}", re.DOTALL)
_BEGINS: Final = re.compile(r"(?i:who|what|how|where|whether|why|nobody|that)\b(?!.*\?$)")
_LITERAL: Final = re.compile(
    r"""//[^\n]*|/\*.*?\*/|"(?:\\.|[^"\\\n])*"|'(?:\\.|[^'\\\n])*'|`(?:\\.|\$\{[^{}]*\}|[^`\\])*`""",
    re.DOTALL,
)
"""A comment or a string of JavaScript."""
_CODE: Final = re.compile(r"<(script|style)\b[^>]*>(.*?)</\1>", re.DOTALL)
_ATTRIBUTE: Final = re.compile(r'\b(?:title|alt|placeholder|aria-label)="([^"]*)"')
_WITHIN: Final = re.compile(r"</?(?:a|b|code|em|i|kbd|small|strong)\b[^>]*>")
"""A tag within a sentence."""


def texts(string: str) -> Iterator[str]:
    """Yield the paragraphs of a string that are texts; `; ` ends a sentence of a message."""
    prose_lines = (
        "" if re.match(r"\s{2}|\t", line) or re.search(r"\S {2,}\S", line) else line.lstrip("# ")
        for line in string.splitlines()
    )
    for paragraph in re.split(r"\n\s*\n", "\n".join(prose_lines)):
        if _SHOWN.search(paragraph):
            yield " ".join(paragraph.split())


def faults(string: str) -> Iterator[str]:
    """Yield what is wrong with a string that is shown."""
    for text in texts(string):
        if match := _BEGINS.match(text):
            yield f"{match[0]!r} in {text[:60]!r}: begin with the subject"
        for part in text.split("; "):
            yield from prose.faults(part)


def strings(node: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield the strings of Python with their lines, but those that stand alone."""
    match node:
        case ast.Expr(value=ast.Constant()):
            return
        case ast.Constant(value=str(text)):
            yield node.lineno, text
        case ast.JoinedStr(values=parts):
            yield (
                node.lineno,
                "".join(
                    str(part.value) if isinstance(part, ast.Constant) else _VALUE for part in parts
                ),
            )
            for part in parts:
                if isinstance(part, ast.FormattedValue):
                    yield from strings(part.value)
        case _:
            for child in ast.iter_child_nodes(node):
                yield from strings(child)


def script_strings(source: str) -> Iterator[tuple[int, str]]:
    """Yield the strings and comments of JavaScript with their lines."""
    for match in _LITERAL.finditer(source):
        literal = match[0]
        text = literal.strip("/* ") if literal[0] == "/" else literal[1:-1]
        yield source.count("\n", 0, match.start()) + 1, re.sub(r"\$\{[^{}]*\}", _VALUE, text)


def page_strings(source: str) -> Iterator[tuple[int, str]]:
    """Yield the texts, labels and strings of scripts of a page of HTML with their lines."""

    def line(at: int) -> int:
        return source.count("\n", 0, at) + 1

    for match in _CODE.finditer(source):
        if match[1] == "script":
            first = line(match.start(2)) - 1
            yield from ((first + at, text) for at, text in script_strings(match[2]))
    source = _CODE.sub(lambda match: re.sub(r"[^\n]", " ", match[0]), source)
    for match in _ATTRIBUTE.finditer(source):
        yield line(match.start()), match[1]
    source = re.sub(r"\{\{.*?\}\}", _VALUE, re.sub(r"\{%.*?%\}", "", source))
    for number, row in enumerate(_WITHIN.sub("", source).splitlines(), 1):
        yield from ((number, text) for text in re.split(r"<[^>]*>", row))


def shown(name: str, source: str) -> Iterable[tuple[int, str]]:
    """Return the strings of a file by the ending of its name."""
    if name.endswith(".py"):
        return strings(ast.parse(source))
    return (page_strings if name.endswith(".html") else script_strings)(source)
