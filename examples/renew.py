"""Run the notebooks beside this file in a real kernel, and keep their output.

    python examples/renew.py

A test compares the stored output with that of the present program.
"""

from __future__ import annotations

import sys
from pathlib import Path

import nbformat
from nbclient import NotebookClient

HERE = Path(__file__).parent


def renew(path: Path) -> None:
    """Run a notebook from its beginning; raise the errors of its cells."""
    notebook = nbformat.read(path, as_version=4)
    NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(HERE)}}).execute()
    for cell in notebook.cells:
        cell.metadata.clear()  # when it was run, which differs from run to run
        for output in cell.get("outputs", ()):
            if "image/png" in output.get("data", {}):
                output.data.pop("image/jpeg", None)  # the same once more
    notebook.metadata = {"kernelspec": notebook.metadata["kernelspec"]}
    nbformat.write(notebook, path)


if __name__ == "__main__":
    for found in sorted(HERE.glob("*.ipynb")):
        sys.stderr.write(f"{found.name}\n")
        renew(found)
