"""Latency of the studio in a real browser, from a drag to the new cloud; memory while dragging.

    python benchmarks/studio.py [--drags 200] [--minutes 0]

Needs the extras studio and test, chromium and chromedriver. A drag is one place that the pointer
is moved to while it holds a handle; its time ends when the browser has the poles of the law that
was found for it. With --minutes the pointer goes on at random, and the server's memory is printed.
"""

import argparse
import random
import statistics
import sys
import tempfile
import time
from pathlib import Path

from polefence.examples import spec_text

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from support.browser import browser, studio, text_of, until

REGION = "disk(-40, 33)"
HANDLE = """
const view = Bokeh.index.find_one(Bokeh.documents[0].get_model_by_name("poles"))
const box = view.el.getBoundingClientRect()
const {x, y} = view.model.renderers.find(own => own.name == "handles").data_source.data
return [box.left + view.frame.x_scale.compute(x[0]), box.top + view.frame.y_scale.compute(y[0])]
"""
TIMES = """
for (const own of Bokeh.documents[0]._all_models.values()) if (own.times) return own.times
return []
"""


def memory(process):
    """Resident memory of a process [MB]."""
    for line in Path(f"/proc/{process.pid}/status").read_text().splitlines():
        if line.startswith("VmRSS"):
            return int(line.split()[1]) / 1024
    return 0.0


def dragged(page, count, generator):
    """Drag the top of the disk up and down."""
    from selenium.webdriver import ActionChains

    x, y = page.execute_script(HANDLE)
    chain = ActionChains(page, duration=50)
    pointer = chain.w3c_actions.pointer_action
    pointer.move_to_location(round(x), round(y))
    pointer.pointer_down()
    for _ in range(count):
        pointer.move_to_location(round(x), round(y + generator.uniform(-10, 10)))
    pointer.move_to_location(round(x), round(y))
    pointer.pointer_up()
    chain.perform()


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--drags", type=int, default=200)
    parser.add_argument("--minutes", type=float, default=0.0)
    options = parser.parse_args()
    generator = random.Random(1)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "car.toml").write_text(spec_text("quarter-car-physical"))
        with (
            studio(folder, "car.toml", "--region", REGION) as (address, process),
            browser() as page,
        ):
            page.get(address)
            until(lambda: f"proved: all poles in {REGION}" in text_of(page))
            times = []
            while len(times) < options.drags:
                dragged(page, 40, generator)
                time.sleep(0.5)
                times = page.execute_script(TIMES)
            times = times[: options.drags]
            print(f"{len(times)} drags: median {statistics.median(times):.0f} ms, ", end="")
            print(f"{sum(t <= 100 for t in times)} within 100 ms, worst {max(times):.0f} ms")
            begin, end = time.monotonic(), time.monotonic() + 60 * options.minutes
            while time.monotonic() < end:
                dragged(page, 40, generator)
                print(f"{(time.monotonic() - begin) / 60:6.1f} min {memory(process):8.0f} MB")


if __name__ == "__main__":
    main()
