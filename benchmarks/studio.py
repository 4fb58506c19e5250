"""Latency of the studio in a real browser, from a drag to the new cloud; memory while dragging.

    python benchmarks/studio.py [--drags 200] [--minutes 0]

Needs the extras studio and test, chromium and chromedriver. A drag is one place that the pointer
is moved to while it holds a handle; its time ends when the browser has the poles of the law that
was found for it. A proof's time begins when the pointer lets go, and ends when the badge says that
the last law is proved. With --minutes the pointer goes on at random, on every handle, and the
server's memory is printed.
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
HANDLES = """
const view = Bokeh.index.find_one(Bokeh.documents[0].get_model_by_name("poles"))
const box = view.el.getBoundingClientRect()
const {x, y} = view.model.renderers.find(own => own.name == "handles").data_source.data
return [...x].map((own, i) => [
  box.left + view.frame.x_scale.compute(own), box.top + view.frame.y_scale.compute(y[i])
])
"""
TIMES = """
for (const own of Bokeh.documents[0]._all_models.values()) if (own.times) return own.times
return []
"""
# Every 5 ms: whether the badge says that something is proved since the pointer let go.
PROOFS = """
window.proofs = []
let up = 0
addEventListener("pointerup", () => { up = performance.now() }, true)
const find = (node) => {
  if (node.classList && node.classList.contains("badge")) return node
  for (const own of [node.shadowRoot, ...node.childNodes]) {
    const found = own && find(own)
    if (found) return found
  }
}
setInterval(() => {
  const own = up && find(document.body)
  if (own && own.classList.contains("proved")) {
    window.proofs.push(performance.now() - up)
    up = 0
  }
}, 5)
"""
WAYS = 10  # [pixels] either way


def memory(process):
    """Resident memory of a process [MB]."""
    for line in Path(f"/proc/{process.pid}/status").read_text().splitlines():
        if line.startswith("VmRSS"):
            return int(line.split()[1]) / 1024
    return 0.0


def dragged(page, count, generator, every=False, back=True):
    """Drag the top of the disk up and down, or any handle to and fro, and back or up."""
    from selenium.webdriver import ActionChains

    places = page.execute_script(HANDLES)
    x, y = generator.choice(places) if every else places[0]
    chain = ActionChains(page, duration=50)
    pointer = chain.w3c_actions.pointer_action
    pointer.move_to_location(round(x), round(y))
    pointer.pointer_down()
    for _ in range(count):
        aside = generator.uniform(-WAYS, WAYS) if every else 0.0
        pointer.move_to_location(round(x + aside), round(y + generator.uniform(-WAYS, WAYS)))
    pointer.move_to_location(round(x), round(y if back else y - generator.uniform(1, WAYS)))
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
                dragged(page, 20, generator)
                time.sleep(1.0)
                times = page.execute_script(TIMES)
            page.execute_script(PROOFS)
            for _ in range(20):
                dragged(page, 3, generator, back=False)  # to a region that is not known
                time.sleep(1.0)
            proofs = page.execute_script("return window.proofs")
            for what, own in (("drags", times[: options.drags]), ("proofs", proofs)):
                print(f"{len(own)} {what}: median {statistics.median(own):.0f} ms, ", end="")
                print(f"{sum(t <= 100 for t in own)} within 100 ms, worst {max(own):.0f} ms")
            begin, end = time.monotonic(), time.monotonic() + 60 * options.minutes
            while time.monotonic() < end:
                dragged(page, 40, generator, every=True)
                gone = (time.monotonic() - begin) / 60
                print(f"{gone:6.1f} min {memory(process):8.0f} MB", flush=True)


if __name__ == "__main__":
    main()
