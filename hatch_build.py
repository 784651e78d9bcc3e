"""README of the distributions, which has to make sense without the repository beside it.

Where `SOURCE_URL` names the repository's address, pictures and links of README.md lead there.
Without, they are left out: a package index can show none that is relative.
"""

import os
import re
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

_COMMENT = re.compile(r"<!--.*?-->\n?", re.S)
_LINK = re.compile(r"(!?)\[([^\]]*)\]\((?!https?:)([^)\s]+)\)")


def readme(text: str, source: str) -> str:
    """README.md for a package index.

    Args:
        text: README.md.
        source: Address of the repository; "" if it has none.
    """

    def elsewhere(match: re.Match) -> str:
        picture, shown, path = match.groups()
        if not source:
            return f"*{shown}*" if picture else shown
        return f"{picture}[{shown}]({source}/{'raw' if picture else 'blob'}/HEAD/{path})"

    return _LINK.sub(elsewhere, _COMMENT.sub("", text))


class Readme(MetadataHookInterface):
    """Sets what pyproject.toml calls dynamic."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Set `readme`, and `urls` where there is an address."""
        source = os.environ.get("SOURCE_URL", "").rstrip("/")
        if source and not source.startswith("https://"):
            raise ValueError(f"SOURCE_URL must begin with https://, got {source!r}")
        text = (Path(self.root) / "README.md").read_text(encoding="utf-8")
        metadata["readme"] = {"content-type": "text/markdown", "text": readme(text, source)}
        metadata["urls"] = {"Source": source} if source else {}
