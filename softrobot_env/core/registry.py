"""Registries: entries of one kind by name, whose code is loaded when it is asked for.

Other packages add entries: a function that an installed package names in the entry-point group
`softrobot_env` is called once, when a name is first asked for that a registry does not have, or
when its names are listed.
"""

import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from traceback import walk_tb
from typing import Any, Generic, TypeVar
from warnings import warn

from .files import readable

Entry = TypeVar("Entry")

#: Groups of the entry points that installed packages register with: robots, tasks, policies and
#: trainings, called when they are asked for; and ids of environments, called when this package is
#: imported, so that they should import little.
GROUP, ENVIRONMENT_GROUP = "softrobot_env", "softrobot_env.environments"


#: Packages whose code was asked for by name: results may depend on it.
PACKAGES = {"softrobot_env"}

_called: set[str] = set()


def load_plugins(group: str = GROUP) -> None:
    """Call what installed packages name in an entry-point group, once in a process.

    One that fails is reported in a warning, and changes nothing for the others.
    """
    if group in _called:
        return
    _called.add(group)  # first: what is called may look up entries itself
    for point in _entry_points(group):
        try:
            PACKAGES.add(package_of(point.module))
            point.load()()
        except (Exception, SystemExit) as error:  # whatever it is, it is not ours
            package = "" if point.dist is None else f" of the package {point.dist.name}"
            warn(
                f"the plug-in {point.name!r}{package} ({point.value}) is left out: "
                f"{type(error).__name__}: {error}",
                stacklevel=2,
            )


#: Beside the package in a checkout: its studies are a plug-in as any other.
_SCRIPTS = Path(__file__).resolve().parents[2] / "scripts"


def _entry_points(group: str) -> list[EntryPoint]:
    """In the order of their names, so that it does not depend on the installation."""
    found = [*entry_points(group=group)]
    if group == GROUP and (_SCRIPTS / "studies" / "__init__.py").is_file():
        if str(_SCRIPTS) not in sys.path:
            sys.path.append(str(_SCRIPTS))
        found.append(EntryPoint("studies", "studies:register", GROUP))
    return sorted(found, key=lambda point: (point.name, point.value))


class Registry(Mapping[str, Entry], Generic[Entry]):
    """Entries by name, in the order in which they were written down.

    Attributes:
        kind: What an entry is, for messages.
    """

    def __init__(self, kind: str, entries: Mapping[str, Entry]) -> None:
        self.kind, self._own = kind, dict(entries)

    def registered(self) -> dict[str, Entry]:
        """The entries there are so far: plug-ins are not asked."""
        return self._own

    def __getitem__(self, name: str) -> Entry:
        if name not in self.registered():
            load_plugins()
        return self.registered()[name]

    def __iter__(self) -> Iterator[str]:
        load_plugins()
        return iter(list(self.registered()))

    def __len__(self) -> int:
        load_plugins()
        return len(self.registered())

    def find(self, name: str) -> Entry:
        """The entry of a name.

        Raises:
            ValueError: There is none; the message lists the names.
        """
        if name not in self:
            raise ValueError(f"unknown {self.kind} {name!r}; choose from {', '.join(self)}")
        return self[name]

    def register(self, name: str, entry: Entry, replace: bool = False) -> None:
        """Add an entry, or replace one.

        Raises:
            ValueError: The name is taken and `replace` is not set, or it is no name that a command
                could be given.
        """
        check_name(self.kind, name)
        if name in self._own and not replace:
            raise ValueError(f"the {self.kind} {name!r} is there already; replace=True replaces it")
        self._own[name] = entry


def check_name(kind: str, name: str) -> None:
    """Raise ValueError unless a name can stand on a command line and in a file name."""
    if not isinstance(name, str) or not name.replace("_", "").replace("-", "").isalnum():
        raise ValueError(f"the name of a {kind} consists of letters, digits, _ and -, got {name!r}")
    if name == "all":
        raise ValueError(f"a {kind} cannot be called 'all', which stands for every one")


def package_of(module: str) -> str:
    """The package that a module is in."""
    return module.partition(".")[0]


def load(path: str) -> Any:
    """The object that a path `package.module:name` or `file.py:name` stands for.

    Raises:
        ImportError, AttributeError: There is no such module, or it has no such name.
        OSError: There is no such file.
    """
    module, _, name = path.rpartition(":")
    if not module.endswith(".py"):
        PACKAGES.add(package_of(module))
        return getattr(import_module(module), name)
    file = Path(module).resolve()
    return getattr(_run_file(readable(file), file.stat().st_mtime_ns), name)


@cache
def _run_file(path: Path, _written: int) -> Any:
    """The module that a file of Python code makes, run once as it is."""
    spec = spec_from_file_location(f"softrobot_file_{path.stem}", path)
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def is_path(text: str) -> bool:
    """Whether a text names an object in a module or a file, and not an entry of a registry."""
    return ":" in text


#: Errors by which code refuses what it is asked for, in a line.
REFUSALS = (ValueError, ImportError, RuntimeError, OSError, ArithmeticError, MemoryError)


class OutsideError(ValueError):
    """Code from outside is not what it was given for, failed, or wanted to end the program."""

    @classmethod
    def of(cls, what: str, error: BaseException) -> "OutsideError":
        """What is raised in place of an error, with where that came from."""
        *_, (frame, line) = walk_tb(error.__traceback__)
        place = f"{Path(frame.f_code.co_filename).name}, line {line}"
        return cls(f"{what}: {type(error).__name__}: {error} ({place})")


@contextmanager
def outside(what: str) -> Iterator[None]:
    """Run code from outside within it, which may refuse what it is asked for.

    Raises:
        OutsideError: It failed, or wanted to end the program; the message says what and where.
    """
    try:
        yield
    except REFUSALS:
        raise
    except (Exception, SystemExit) as error:
        raise OutsideError.of(what, error) from error


def load_given(kind: str, path: str) -> Any:
    """What a user's path `package.module:name` or `file.py:name` stands for.

    Raises:
        ValueError: There is no such thing, or its code fails; the message says why.
        OutsideError: Its code wants to end the program.
    """
    module, _, name = path.rpartition(":")
    if not module or not name:
        raise ValueError(
            f"the {kind} {path!r} is neither a name nor 'package.module:name' or 'file.py:name'"
        )
    try:
        return load(path)
    except SystemExit as error:
        raise OutsideError.of(f"the {kind} {path!r}", error) from error
    except Exception as error:
        raise ValueError(f"the {kind} {path!r}: {type(error).__name__}: {error}") from error


class Variants:
    """What takes the place of something for the robots that it fits, by kind and name.

    A plug-in may have a better law for some robots under a name that any robot can be given.
    """

    def __init__(self) -> None:
        self._known: dict[str, list[tuple[Callable[[Any], bool] | str, Any]]] = {}

    def register(self, name: str, fits: Callable[[Any], bool] | str, entry: Any) -> None:
        """Add a variant.

        Args:
            name: Kind and name of what it stands in for, such as "policy lqi", "training lqi", or
                of something that other robots lack, such as "visits".
            fits: Whether it fits a robot; a function, or the path of one.
            entry: The variant.
        """
        self._known.setdefault(name, []).append((fits, entry))

    def find(self, name: str, robot: Any) -> Any:
        """The variant of a name that fits a robot; None without one."""
        load_plugins()
        for fits, entry in self._known.get(name, ()):
            if (load(fits) if isinstance(fits, str) else fits)(robot):
                return entry
        return None


#: The variants.
VARIANTS = Variants()

#: Module and name -> path of what a plug-in holds under this name.
_SERVED: dict[tuple[str, str], str] = {}


def serve_names(module: str, source: str, names: str) -> None:
    """Let a module that says `__getattr__ = served(__name__)` give names of another one.

    Args:
        module: The module that is asked.
        source: The one that has them.
        names: With spaces between them.
    """
    _SERVED.update({(module, name): f"{source}:{name}" for name in names.split()})


def served(module: str) -> Callable[[str], Any]:
    """The `__getattr__` of a module whose further names plug-ins hold, see `serve_names`."""

    def get(name: str) -> Any:
        if not name.startswith("__"):
            load_plugins()
        if (module, name) not in _SERVED:
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        return load(_SERVED[module, name])

    return get
