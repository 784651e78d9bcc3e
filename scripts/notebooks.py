"""Make Jupyter notebooks of the examples that make a picture.

python scripts/notebooks.py                 # the five of docs/notebooks, without outputs
python scripts/notebooks.py --run           # the same, executed: minutes; needs nbclient, ipykernel
python scripts/notebooks.py out/notebooks   # of all examples, into a folder
"""

import ast
import json
import sys
import tempfile
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from pathlib import Path

from softrobot_env.core.files import write_text

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES, NOTEBOOKS = ROOT / "examples", ROOT / "docs" / "notebooks"

#: Examples that docs/notebooks has as notebooks, each with what `pip` has to install.
SHOWN = {
    "own_robot": "viz",
    "compare_controllers": "viz",
    "train_and_show": "viz,rl",
    "identify_stiffness": "viz",
    "virtual_rig": "viz,robot",
}


def cell(kind: str, source: str) -> dict:
    """A cell of nbformat 4."""
    made = {"cell_type": kind, "metadata": {}, "source": source}
    return made | ({"execution_count": None, "outputs": []} if kind == "code" else {})


def notebook(text: str, extras: str = "all") -> dict:
    """An example's text as a notebook: its docstring, a cell for each step, its picture.

    A comment that begins a step is the text above its cell. The first code cell says how to
    install the package with its extras.
    """
    tree = ast.parse(text)
    lines, starts = text.splitlines(), {1}
    for node in tree.body[1:]:
        above = node.lineno - 1  # as a comment would be
        if lines[above - 1].startswith("# "):
            starts.add(above)
    install = (
        "# The package is not on an index yet: give pip the path of the checkout or of a wheel.\n"
        f'# %pip install "path/to/softrobot_env[{extras}]"'
    )
    cells = [cell("markdown", ast.get_docstring(tree)), cell("code", install)]
    marks = sorted(starts)
    begin = tree.body[0].end_lineno
    for first, last in zip(marks, [*marks[1:], len(lines) + 1], strict=True):
        step = lines[begin if first == 1 else first - 1 : last - 1]
        if first > 1:
            cells.append(cell("markdown", step.pop(0).removeprefix("# ")))
        cells.append(cell("code", "\n".join(step).strip()))
    cells.append(cell("code", "from IPython.display import Image\n\nImage(picture)"))
    return {"cells": cells, "metadata": {}, "nbformat": 4, "nbformat_minor": 4}


def executed(made: dict) -> dict:
    """A notebook with its outputs, run in a folder of its own; stderr is left out."""
    import nbformat
    from nbclient import NotebookClient

    read = nbformat.reads(json.dumps(made), as_version=4)
    with tempfile.TemporaryDirectory() as room:
        resources = {"metadata": {"path": room}}
        NotebookClient(read, timeout=1800, record_timing=False, resources=resources).execute()
    for one in read.cells:
        if one.cell_type == "code":
            one.outputs = [x for x in one.outputs if x.get("name") != "stderr"]
    return json.loads(nbformat.writes(read))


def sources(made: dict) -> list[tuple[str, str]]:
    """Kind and text of each cell."""
    return [(x["cell_type"], "".join(x["source"])) for x in made["cells"]]


def main(words: list[str]) -> int:
    """Write the notebooks to a folder."""
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, nargs="?", help="for all examples")
    parser.add_argument("--run", action="store_true", help="execute them")
    args = parser.parse_args(words)
    folder = args.folder or NOTEBOOKS
    for path in sorted(EXAMPLES.glob("*.py")):
        text = path.read_text(encoding="utf-8")
        if path.stem in SHOWN or (args.folder and "\npicture = " in text):
            made = notebook(text, SHOWN.get(path.stem, "all"))
            made = executed(made) if args.run else made
            write_text(folder / f"{path.stem}.ipynb", json.dumps(made, indent=1) + "\n")
            print(f"Wrote {folder / path.stem}.ipynb")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
