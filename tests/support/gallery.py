"""Pages of the gallery beside what their scripts print and draw."""

import io
import re
from contextlib import redirect_stdout
from types import SimpleNamespace

import pytest

from support.paths import DOCS

NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]\d+)?")


def page(name):
    """The text of a page."""
    return (DOCS / f"gallery-{name}.md").read_text()


def alike(name, said, folder):
    """Compare what a page shows with what its script has printed and drawn.

    What code that the page itself spells out prints, a test of its own compares.
    """
    script = re.sub(r"```python\n.*?```\n\n```text\n.*?```", "", page(name), flags=re.DOTALL)
    (shown,) = re.findall(r"```text\n(.*?)```", script, re.DOTALL)
    assert words(said) == words(shown)
    ours, theirs = ([float(x) for x in NUMBER.findall(text)] for text in (said, shown))
    assert ours == pytest.approx(theirs, rel=1e-2, abs=1e-9)
    drawn = {own.name for own in folder.glob("*.png")}
    assert drawn == set(re.findall(r"\(images/(.*?\.png)\)", page(name)))
    assert all((folder / own).stat().st_size > 10_000 for own in drawn)


def words(text):
    """A text without its numbers."""
    return re.sub(r"\s+", " ", NUMBER.sub("#", text))


def recorded(script, folder, drawn, exported):
    """What one run of a script said; by these names, what it drew and what it exported."""
    own = SimpleNamespace()
    draw, export = script.draw, script.exported

    def drawing(*given):
        vars(own).update(zip(drawn, given, strict=False))
        draw(*given)

    def exporting():
        found = export()
        vars(own).update(zip(exported, found, strict=True))
        return found

    with pytest.MonkeyPatch.context() as patch, redirect_stdout(io.StringIO()) as said:
        patch.setattr(script, "draw", drawing)
        patch.setattr(script, "exported", exporting)
        script.main(folder)
    own.said = said.getvalue()
    (own.image,) = folder.glob("*.png")
    return own
