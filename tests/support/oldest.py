"""Print the oldest versions that pyproject.toml allows, as constraints for pip."""

import re
import sys
import tomllib
from pathlib import Path


def constraints() -> list[str]:
    """Return ``name==version`` for each dependency with a least version."""
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    wanted = [*project["dependencies"], *extras["control"], *extras["parquet"]]
    return [re.sub(r">=", "==", line) for line in wanted]


if __name__ == "__main__":
    sys.stdout.write("\n".join(constraints()) + "\n")
