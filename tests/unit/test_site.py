"""Documentation that is made from the program: mission reference, notebooks, names."""

from __future__ import annotations

import ast
import asyncio
import inspect
import json
from typing import Any

import matplotlib as mpl
import pytest
from pydantic import BaseModel

import uavmap
from missions import errors
from missions.mission.messages import section_of
from missions.mission.schema import Mission
from tests.reference_pages import FOLDER, PAGES
from tests.unit.test_pages import ROOT
from uavmap.load.areas.mission_reference import reference

EXAMPLES = ROOT / "examples"


# --- the reference of mission files --------------------------------------------------------------
def keys_of(section: type[BaseModel], name: str = "") -> set[str]:
    """Return every key of a table and of those in it, with dots, as pydantic has them."""
    found = set()
    for key, field in section.model_fields.items():
        full = f"{name}.{key}" if name else key
        inner = section_of(field.annotation)
        found |= {full} if inner is None else keys_of(inner, full)
    return found - {"detector.tables"}


def test_the_reference_is_that_of_the_schema():
    page = (ROOT / "docs" / "reference" / "missions.md").read_text("utf-8")
    assert page == reference(), (
        "python -m uavmap.load.areas.mission_reference > docs/reference/missions.md"
    )


def test_reference_describes_every_key():
    page, table, described = reference(), "", dict[str, str]()
    for line in page.splitlines():
        if line.startswith("## "):
            table = f"{line.strip('# `[]')}." if "[" in line else ""
        elif line.startswith("| `"):
            key, *_, what = line.removesuffix(" |").split(" | ")
            described[table + key.strip("| `")] = what
    assert keys_of(Mission) <= set(described)
    assert [key for key, text in described.items() if not text.strip("| ")] == []
    assert '| `altitude_m` | number or `"auto"` | m | above 0, up to 1000 | `12.0` |' in page
    assert "| `polygon` | ring |  |  | *needed* |" in page
    assert "| `m_s` | number | m/s |" in page


@pytest.mark.parametrize("name", PAGES)
def test_the_page_of_the_reference_is_that_of_the_program(name):
    page = (FOLDER / name).read_text("utf-8")
    assert page == PAGES[name](), "python -m tests.reference_pages"


# --- the names of Python -------------------------------------------------------------------------
def test_the_page_of_names_has_all_of_them():
    page = (ROOT / "docs" / "reference" / "api.md").read_text("utf-8")
    names = {name for name in uavmap.__all__ if not name.endswith(("Error", "__"))}
    shown = {line.rpartition(".")[2] for line in page.splitlines() if line.startswith("::: ")}
    assert names | {"errors"} == shown


def test_every_error_is_a_name_of_uavmap():
    """The internal error of the journal is the exception."""
    known = {
        name
        for name, value in vars(errors).items()
        if inspect.isclass(value) and issubclass(value, errors.UavmapError)
    }
    assert known - {"EventError"} == {name for name in uavmap.__all__ if name.endswith("Error")}


# --- the notebooks -------------------------------------------------------------------------------
async def ran(cell: str, names: dict[str, Any]) -> object:
    """Run a cell as a notebook does; return the value of its last line if it is an expression."""
    tree = ast.parse(cell)
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    codes = [compile(tree, "cell", "exec", ast.PyCF_ALLOW_TOP_LEVEL_AWAIT)]
    if isinstance(last, ast.Expr):
        expression = ast.Expression(last.value)
        codes.append(compile(expression, "cell", "eval", ast.PyCF_ALLOW_TOP_LEVEL_AWAIT))
    value: object = None
    for code in codes:
        value = eval(code, names)
        if inspect.iscoroutine(value):
            value = await value
    return value


@pytest.mark.parametrize("name", ["flight", "pictures"])
def test_notebook_shows_the_output_of_the_program(name, monkeypatch):
    """Each cell runs on a running loop, as in a notebook; `examples/renew.py` renews them."""
    mpl.use("agg")
    from matplotlib import pyplot as plt  # noqa: PLC0415 - after its backend

    monkeypatch.chdir(EXAMPLES)
    notebook = json.loads((EXAMPLES / f"{name}.ipynb").read_text("utf-8"))
    names: dict[str, Any] = {"__name__": "__main__"}

    async def whole() -> None:
        for cell in notebook["cells"]:
            if cell["cell_type"] == "code":
                value = await ran("".join(cell["source"]), names)
                if hasattr(value, "_repr_png_"):
                    value._repr_png_()  # as a notebook draws it: it reads its file to the end
                reported = [o for o in cell["outputs"] if o["output_type"] == "execute_result"]
                texts = ["".join(o["data"]["text/plain"]) for o in reported if len(o["data"]) == 1]
                if texts:
                    assert squeezed(repr(value)) == squeezed(texts[0])

    asyncio.run(whole())
    plt.close("all")


def squeezed(text: str) -> str:
    """Return a text without its line breaks."""
    return "".join(text.split())
