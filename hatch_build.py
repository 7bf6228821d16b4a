"""Metadata that follow from where the package is published: addresses, and a README whose links lead somewhere."""

import re
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

RELATIVE = re.compile(r"(?P<picture>!?)\[(?P<text>[^\]]*)\]\((?P<target>(?![a-z]+://|#)[^)\s]+)\)")


def published_readme(text: str, repository: str, branch: str) -> str:
    """Return the README with absolute links and pictures, or without them where there is no repository."""

    def replaced(found: re.Match[str]) -> str:
        if not repository:
            return "" if found["picture"] else found["text"]
        kind = "raw" if found["picture"] else "blob"
        return f"{found['picture']}[{found['text']}]({repository}/{kind}/{branch}/{found['target']})"

    return RELATIVE.sub(replaced, text)


class PublicationHook(MetadataHookInterface):
    """Fills in `readme` and `urls` from the table ``[tool.steelyard.publication]`` of pyproject.toml."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Change the metadata in place."""
        import tomllib

        root = Path(self.root)
        given = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["steelyard"]["publication"]
        repository = given["repository"].rstrip("/")
        readme = published_readme((root / "README.md").read_text(encoding="utf-8"), repository, given["branch"])
        metadata["readme"] = {"content-type": "text/markdown", "text": readme}
        addresses = {"Repository": repository, "Issues": given["issues"], "Documentation": given["documentation"]}
        metadata["urls"] = {name: address for name, address in addresses.items() if address}
