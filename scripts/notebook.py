"""The notebook of the documents: its cells run in order, as Jupyter would run them.

Jupyter is not needed. `python scripts/notebook.py docs/first_result.ipynb` runs a notebook and
writes what its cells print and draw into it.
"""

from __future__ import annotations

import ast
import base64
import contextlib
import io
import json
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib

ROOT = Path(__file__).parents[1]


def read(path: Path) -> dict[str, Any]:
    """Return a notebook; the text of a cell is a list of lines."""
    notebook: dict[str, Any] = json.loads(path.read_text("utf-8"))
    return notebook


def run(
    notebook: dict[str, Any], folder: Path
) -> Iterator[tuple[dict[str, Any], str, list[bytes]]]:
    """Run the code cells in a folder; return each with what it prints and its figures as PNG."""
    matplotlib.use("agg")
    from matplotlib import pyplot

    names: dict[str, Any] = {"__name__": "notebook"}
    for number, cell in enumerate(notebook["cells"]):
        if cell["cell_type"] != "code":
            continue
        printed, figures = io.StringIO(), []
        with contextlib.ExitStack() as around:
            around.enter_context(contextlib.chdir(folder))
            around.enter_context(contextlib.redirect_stdout(printed))
            around.enter_context(warnings.catch_warnings())
            warnings.simplefilter("ignore")
            _execute("".join(cell["source"]), f"cell {number}", names)
        for figure in map(pyplot.figure, pyplot.get_fignums()):
            drawn = io.BytesIO()
            figure.savefig(drawn, dpi=90, bbox_inches="tight", metadata={"Software": None})
            figures.append(drawn.getvalue())
        pyplot.close("all")
        yield cell, printed.getvalue(), figures


def _execute(source: str, name: str, names: dict[str, Any]) -> None:
    """Execute a cell, and print the value of its last line if that is an expression."""
    tree = ast.parse(source, name)
    last = tree.body[-1] if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    if last is None:
        exec(compile(tree, name, "exec"), names)
        return
    exec(compile(ast.Module(tree.body[:-1], []), name, "exec"), names)
    value = eval(compile(ast.Expression(last.value), name, "eval"), names)
    if value is not None and not source.rstrip().endswith(";"):
        print(repr(value))


def printed_by(cell: dict[str, Any]) -> str:
    """Return the text that a cell printed when the notebook was written."""
    return "".join("".join(one.get("text", "")) for one in cell["outputs"])


def pictures_of(cell: dict[str, Any]) -> list[str]:
    """Return the pictures of a cell, as base64 of PNG."""
    data = (one.get("data", {}) for one in cell["outputs"])
    return ["".join(one["image/png"]) for one in data if "image/png" in one]


def write(path: Path) -> None:
    """Run a notebook and write its outputs into it."""
    notebook = read(path)
    for count, (cell, text, figures) in enumerate(run(notebook, ROOT), 1):
        lines = text.splitlines(keepends=True)
        cell["execution_count"], cell["outputs"] = count, []
        if text:
            cell["outputs"].append({"name": "stdout", "output_type": "stream", "text": lines})
        for figure in figures:
            data = {"image/png": base64.b64encode(figure).decode("ascii")}
            cell["outputs"].append({"data": data, "metadata": {}, "output_type": "display_data"})
    path.write_text(json.dumps(notebook, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


if __name__ == "__main__":
    write(Path(sys.argv[1]))
