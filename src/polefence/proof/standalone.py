"""The checker alone, as an application in a zip file that a bare Python runs."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

MAIN = """import sys

if sys.version_info < (3, 11):
    sys.stderr.write("polefence-check.pyz needs Python 3.11 or later\\n")
    sys.exit(2)

from polefence.proof.__main__ import main

sys.exit(main(sys.argv[1:]))
"""
EPOCH = (1980, 1, 1, 0, 0, 0)  # the same bytes whenever it is written


def archive() -> bytes:
    """Return the application: this package alone, the same bytes from the same sources."""
    here = Path(__file__).parent
    files = {"__main__.py": MAIN, "polefence/__init__.py": ""}
    for path in sorted(here.rglob("*.py")):
        files[f"polefence/proof/{path.relative_to(here).as_posix()}"] = path.read_text("utf-8")
    whole = io.BytesIO()
    with zipfile.ZipFile(whole, "w", zipfile.ZIP_STORED) as archived:
        for name in sorted(files):
            entry = zipfile.ZipInfo(name, EPOCH)
            entry.create_system = 3  # wherever it is written
            entry.external_attr = 0o644 << 16
            archived.writestr(entry, files[name].encode())
    return whole.getvalue()
