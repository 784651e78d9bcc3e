"""What to install for the parts of this package that need more than it brings itself."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, requires

_EXTRA = re.compile(r'(?P<requirement>[^;]+?)\s*;\s*extra\s*==\s*["\'](?P<extra>\w+)["\']')

#: Where PyTorch is without the libraries of graphics cards, which take some gigabytes.
_CPU_TORCH = "--extra-index-url https://download.pytorch.org/whl/cpu"


@contextmanager
def needed(what: str, *extras: str) -> Iterator[None]:
    """Import within it what is not always there.

    Args:
        what: For people, what needs which package.
        extras: See `install_command`.

    Raises:
        ImportError: It is missing; the message tells what to install.
    """
    try:
        yield
    except ImportError:
        raise ImportError(f"{what}: {install_command(*extras)}") from None


def install_command(*extras: str) -> str:
    """The command that installs what extras need, wherever the package itself came from.

    Args:
        extras: Out of those of pyproject.toml.
    """
    try:
        stated = requires("softrobot_env") or []
    except PackageNotFoundError:  # run from its sources
        return f'pip install -e ".[{",".join(extras)}]"'
    found = [match for text in stated if (match := _EXTRA.fullmatch(text))]
    chosen = (match["requirement"] for match in found if match["extra"] in extras)
    needed = list(dict.fromkeys(chosen))  # several may need the same
    plain = "gpu" not in extras and any(name.startswith("torch>") for name in needed)
    index = [_CPU_TORCH] if plain else []
    return " ".join(["pip install", *index, *(f'"{name}"' for name in needed)])
