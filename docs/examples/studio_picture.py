"""Take the picture of docs/studio.md: needs the extras studio and test, chromium and chromedriver.

python docs/examples/studio_picture.py FILE.png
"""

import sys
import tempfile
from pathlib import Path

from polefence.examples import spec_text

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
from support.browser import browser, named, studio, text_of, until

FRAMES = """
return [...Bokeh.documents[0]._all_models.values()].find(own => own.type == "Toggle").frames || 0
"""
RIDE = "proved: all poles in half_plane(0); rms of sprung-mass acceleration"
TOP = "document.querySelectorAll('.column').forEach(own => own.scrollTop = 0)"

with tempfile.TemporaryDirectory() as name:
    folder = Path(name)
    (folder / "car.toml").write_text(spec_text("quarter-car-ride"))
    with (
        studio(folder, "car.toml") as (address, _),
        browser(1366, 768) as page,
    ):
        page.get(address)
        until(lambda: "with this law: " in text_of(page))
        named(page, "the best ride").click()
        until(lambda: RIDE in text_of(page))
        named(page, "Fit view").click()
        named(page, "Play").click()
        until(lambda: page.execute_script(FRAMES) > 60)
        named(page, "Pause").click()
        page.execute_script(TOP)
        page.save_screenshot(sys.argv[1])
