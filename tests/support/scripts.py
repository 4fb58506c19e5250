"""The scripts behind the documentation's pages, as modules."""

import importlib.util
import sys
from types import ModuleType

from support.paths import DOCS


def docs_script(name: str) -> ModuleType:
    """Return a script of docs/examples, run but for its main part."""
    folder = str(DOCS / "examples")
    if folder not in sys.path:  # some have a module in common, beside them
        sys.path.append(folder)
    spec = importlib.util.spec_from_file_location(name, DOCS / "examples" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
