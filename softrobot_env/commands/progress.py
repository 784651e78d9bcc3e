"""The bar that commands show while they work."""

from rich.console import Console
from rich.progress import Progress, TextColumn, TimeElapsedColumn


def progress_on(console: Console) -> Progress:
    """A bar that goes away at the end; its clock runs also while a long part is under way."""
    columns = (*Progress.get_default_columns(), TextColumn("after"), TimeElapsedColumn())
    return Progress(*columns, console=console, transient=True)
