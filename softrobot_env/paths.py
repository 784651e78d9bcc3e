"""The only place that knows where assets/, models/ and firmware/ are."""

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent


def _data_dir(name: str) -> Path:
    """Folder `name` inside an installed wheel, else beside the package in a checkout."""
    packaged = _PACKAGE / "_data" / name
    return packaged if packaged.is_dir() else _PACKAGE.parent / name


def assets_dir() -> Path:
    """Folder of the exported MJCF scenes."""
    return _data_dir("assets")


def models_dir() -> Path:
    """Folder of trained artifacts and their model cards."""
    return _data_dir("models")


def firmware_dir() -> Path:
    """Folder of the microcontroller's sources."""
    return _data_dir("firmware")
