"""Print the oldest versions that the pyproject.toml of both packages promise, as constraints for pip.

usage: minima.py [NAME...]     (without the packages named)
"""

import re
import sys
import tomllib
from pathlib import Path

root = Path(__file__).resolve().parent.parent
tools = {"lint", "docs"}  # which users of the packages do not install
requirements: set[str] = set()
for place in (root, root / "thesis"):
    project = tomllib.loads((place / "pyproject.toml").read_text())["project"]
    requirements.update(r for r in project["dependencies"] if not r.startswith("steelyard"))
    requirements.update(
        r for name, extra in project["optional-dependencies"].items() if name not in tools for r in extra
    )
requirements = {r for r in requirements if not r.startswith("steelyard[")}
for requirement in sorted(requirements):
    match = re.fullmatch(r"([\w.-]+)>=([\d.]+)(;.*)?", requirement)
    if match is None:
        sys.exit(f"minima.py: expected a requirement of the form name>=version, got {requirement!r}")
    if match[1] not in sys.argv[1:]:
        print(f"{match[1]}=={match[2]}{match[3] or ''}")
