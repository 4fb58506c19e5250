"""The pages of the API, as one text."""

from support.paths import DOCS

PAGES = {page.stem: page.read_text() for page in sorted((DOCS / "api").glob("*.md"))}
API = "\n".join(PAGES.values())
