"""What the browser gets: the page, and the scripts that answer at once, without the server."""

from pathlib import Path


def template(name: str) -> str:
    """Return the text of one."""
    return (Path(__file__).parent / name).read_text(encoding="utf-8")
