"""What the browser gets: the page, and the scripts that answer at once, without the server."""

from pathlib import Path

FOLDER = Path(__file__).parent


def template(name: str) -> str:
    """Return the text of one."""
    return (FOLDER / name).read_text(encoding="utf-8")
