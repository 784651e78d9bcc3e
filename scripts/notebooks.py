"""Make a Jupyter notebook of every example that makes a picture.

python scripts/notebooks.py out/notebooks
"""

import ast
import json
import sys
from pathlib import Path

from softrobot_env.core.files import write_text

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


def cell(kind: str, source: str) -> dict:
    """A cell of nbformat 4."""
    made = {"cell_type": kind, "metadata": {}, "source": source}
    return made | ({"execution_count": None, "outputs": []} if kind == "code" else {})


def notebook(text: str) -> dict:
    """An example's text as a notebook: its docstring, a cell for each step, its picture.

    A comment that begins a step is the text above its cell.
    """
    tree = ast.parse(text)
    lines, starts = text.splitlines(), {1}
    for node in tree.body[1:]:
        above = node.lineno - 1  # as a comment would be
        if lines[above - 1].startswith("# "):
            starts.add(above)
    cells, marks = [cell("markdown", ast.get_docstring(tree))], sorted(starts)
    begin = tree.body[0].end_lineno
    for first, last in zip(marks, [*marks[1:], len(lines) + 1], strict=True):
        step = lines[begin if first == 1 else first - 1 : last - 1]
        if first > 1:
            cells.append(cell("markdown", step.pop(0).removeprefix("# ")))
        cells.append(cell("code", "\n".join(step).strip()))
    cells.append(cell("code", "from IPython.display import Image\n\nImage(picture)"))
    return {"cells": cells, "metadata": {}, "nbformat": 4, "nbformat_minor": 4}


def main(words: list[str]) -> int:
    """Write the notebooks to a folder."""
    folder = Path(words[0] if words else "out/notebooks")
    for path in sorted(EXAMPLES.glob("*.py")):
        text = path.read_text(encoding="utf-8")
        if "\npicture = " in text:
            write_text(folder / f"{path.stem}.ipynb", json.dumps(notebook(text), indent=1))
            print(f"Wrote {folder / path.stem}.ipynb")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
