"""Both limits of cars with dampers that are drawn at random, beside those of the car that is shown.

    python benchmarks/random_dampers.py [COUNT]

Quarter cars on a class C road at 20 m/s: 200 to 500 kg empty, loads of 20 % to 100 %, springs of 10
to 45 kN/m, tyres of 130 to 320 kN/m, unsprung 25 to 60 kg, valves from 100 to 600 up to 1500 to
6000 N s/m. A third has an uncertain tyre (15 % up and down) too, of the others one in three has its
acceleration weighted by Wk. Of each: what is proved of the law, what is proved of every logic,
their ratio, and the best damper that stays as it is.
"""

from __future__ import annotations

import re
import sys
import time

import numpy as np

import polefence as pf
from polefence.certify.refutation import lowest
from polefence.examples import spec_text
from polefence.plant.spec import loads
from polefence.vehicle import Damper, velocity_density

TYRE = '[parameter.kt]\nlabel = "tyre"\nrange = [{}, {}]\nunit = "N/m"\n\n[matrices]'
SHOWN = (288.9, 388.9, 10000, 155900, 28.58, 300, 3000, 100.0, "")


def drawn(source: np.random.Generator, k: int) -> tuple[object, ...]:
    """Return the numbers of a car, its tyre's weight, and what else it has."""
    empty = source.uniform(200, 500)
    loaded = empty * source.uniform(1.2, 2)
    spring, tyre, wheel = (
        source.uniform(*ends) for ends in ((1e4, 4.5e4), (1.3e5, 3.2e5), (25, 60))
    )
    low, high, share = source.uniform(100, 600), source.uniform(1500, 6000), source.uniform(30, 250)
    more = "tyre" if k % 3 == 0 else "Wk" if k % 9 in (1, 5) else ""
    numbers = (round(x) for x in (spring, tyre, wheel, low, high, share))
    return (round(empty, 1), round(loaded, 1), *numbers, more)


def asked(car: tuple[object, ...]) -> tuple[pf.UncertainPlant, pf.Rms, list[Damper]]:
    """Return the plant, what is minimised, and the damper."""
    empty, loaded, spring, tyre, wheel, low, high, share, more = car
    text = spec_text("semi-active").replace("[288.9, 388.9]", f"[{empty}, {loaded}]")
    text = text.replace("m2 = 28.58", f"m2 = {wheel}").replace("kt = 155900", f"kt = {tyre}")
    text = text.replace("k = 10000", f"k = {spring}").replace("[0, 100,", f"[0, {share},")
    if more == "tyre":
        ends = (round(0.85 * float(str(tyre))), round(1.15 * float(str(tyre))))
        text = re.sub(r"\nkt = .*\n", "\n", text).replace("[matrices]", TYRE.format(*ends), 1)
    weight = ["Wk", "none"] if more == "Wk" else None
    signals = ["sprung-mass acceleration", "tyre share"]
    least = pf.Rms(signals, 1.0, velocity_density("C", 20), weight=weight)
    damper = Damper("damper force", "suspension deflection", low, high)
    return loads(text), least, [damper]


def row(car: tuple[object, ...]) -> float:
    """Print a car's numbers; return the ratio of both bounds, nan without one."""
    begun = time.perf_counter()
    plant, least, dampers = asked(car)
    try:
        law = pf.semi_active(plant, least, dampers)
    except pf.NotProvedError as error:
        print(*car, f"no upper bound: {error}")
        return float("nan")
    below = lowest(plant, least, law.passive, dampers)
    ratio = law.level / below[1] if below else float("nan")
    words = " ".join(map(str, car))
    print(
        f"{words:46} {law.level:8.4f} {below[1] if below else 0:8.4f} {ratio:6.3f} "
        f"{law.passive:8.4f} {law.degree:2} {time.perf_counter() - begun:5.1f} s",
        flush=True,
    )
    return ratio


def main() -> None:
    """Print a line for each car, then the mean and the largest ratio."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 40
    print("car; proved of the law, of every logic, their ratio, best that stays, degree, time")
    shown = row(SHOWN)
    source = np.random.default_rng(48)
    ratios = np.array([row(drawn(source, k)) for k in range(count)])
    both = np.isfinite(ratios)
    print(
        f"{both.sum()} of {count} cars have both bounds; ratio {ratios[both].mean():.3f} in the "
        f"mean, {ratios[both].max():.3f} at most; {shown:.3f} of the car that is shown"
    )


if __name__ == "__main__":
    main()
