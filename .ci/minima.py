"""Print the oldest versions that pyproject.toml promises, as constraints for pip.

usage: minima.py [NAME...]     (without the packages named)
"""

import re
import sys
import tomllib
from pathlib import Path

project = tomllib.loads((Path(__file__).resolve().parent.parent / "pyproject.toml").read_text())["project"]
extras = project["optional-dependencies"]
tools = {"lint", "docs"}  # which users of the package do not install
requirements = {*project["dependencies"], *(r for extra in extras.keys() - tools for r in extras[extra])}
for requirement in sorted(requirements):
    match = re.fullmatch(r"([\w-]+)>=([\d.]+)", requirement)
    if match is None:
        sys.exit(f"minima.py: expected a requirement of the form name>=version, got {requirement!r}")
    if match[1] not in sys.argv[1:]:
        print(f"{match[1]}=={match[2]}")
