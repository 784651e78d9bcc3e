"""What to install for the parts of this package that need more than it brings itself."""

import re
from importlib.metadata import PackageNotFoundError, requires

_EXTRA = re.compile(r'(?P<requirement>[^;]+?)\s*;\s*extra\s*==\s*["\'](?P<extra>\w+)["\']')

#: Where PyTorch is without the libraries of graphics cards, which take some gigabytes.
_CPU_TORCH = "--extra-index-url https://download.pytorch.org/whl/cpu"


def install_command(*extras: str) -> str:
    """The command that installs what extras need, wherever the package itself came from.

    Args:
        extras: Out of those of pyproject.toml.
    """
    try:
        told = requires("softrobot_env") or []
    except PackageNotFoundError:  # run from its sources
        return f'pip install -e ".[{",".join(extras)}]"'
    found = [match for text in told if (match := _EXTRA.fullmatch(text))]
    chosen = (match["requirement"] for match in found if match["extra"] in extras)
    needed = list(dict.fromkeys(chosen))  # several may need the same
    plain = "gpu" not in extras and any(name.startswith("torch>") for name in needed)
    index = [_CPU_TORCH] if plain else []
    return " ".join(["pip install", *index, *(f'"{name}"' for name in needed)])
