"""Settings of the documentation site; `make docs` builds it."""

import importlib.metadata
import re

import sphinx.application

project = "softrobot_env"
author = "the softrobot_env authors"
copyright = author
try:
    release = importlib.metadata.version(project)
except importlib.metadata.PackageNotFoundError:  # run from a checkout without installation
    release = __import__(project).__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
]
exclude_patterns = ["demo"]
html_theme = "furo"
html_title = f"softrobot_env {release}"

default_role = "code"  # docstrings write `names` as Markdown does
autodoc_member_order = "bysource"
autodoc_typehints = "description"
napoleon_numpy_docstring = False
napoleon_use_ivar = True  # attributes of a dataclass are described once

myst_heading_anchors = 4
myst_enable_extensions = ["colon_fence", "dollarmath"]


def plain(
    app: object, what: str, name: str, obj: object, options: object, lines: list[str]
) -> None:
    """Keep formulas of docstrings as they are: `r_` is no link and `|x|` no substitution."""
    for k, line in enumerate(lines):
        parts = line.split("`")  # every second one is code
        parts[::2] = [re.sub(r"(?<=\w)_(?!\w)|\|", r"\\\g<0>", part) for part in parts[::2]]
        lines[k] = "`".join(parts)


def setup(app: sphinx.application.Sphinx) -> None:
    """Called by Sphinx."""
    app.connect("autodoc-process-docstring", plain)
