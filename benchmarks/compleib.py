"""Static output feedback on the plants of COMPleib: H2 and H-infinity norms, tuned and proved.

python benchmarks/compleib.py --plants DIR --results rows.json

DIR holds a file a plant, NAME.mat or NAME.npz, with the matrices that the library's own function
`[A,B1,B,C1,C,D11,D12,D21] = COMPleib(NAME)` returns: x' = A x + B1 w + B u,
z = C1 x + D11 w + D12 u, y = C x + D21 w. The library is at www.compleib.de; its data are not part
of this package. Plants are left out, by name, where D21 is not zero (a disturbance that passes
straight into what is measured would pass on into u), where nothing disturbs (B1 is zero), and where
there are more states than ``--states``.

Each plant is taken as it is, and with two uncertain parameters: the two entries of A of largest
magnitude (the first of equals, row by row) are each multiplied by a factor in [0.9, 1.1]. One gain
u = K y is tuned for the least worst norm from w to z, and the norm is proved; "above" is the bound
over the worst sample, less one: samples prove nothing, so the truth lies between. Each plant runs
in a process of its own, on one thread; with ``--results`` a run that was ended goes on where it
was. Prints Markdown.
"""

from __future__ import annotations

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"

import argparse
import json
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from polefence import (
    Gain,
    Parameter,
    PolefenceError,
    Rms,
    Specification,
    Structure,
    UncertainPlant,
    optimise,
)
from polefence.certify.bounds import sampled
from polefence.plant.outputs import Output
from polefence.plant.system import System

KEYS = ("A", "B1", "B", "C1", "C", "D11", "D12", "D21")
SPREAD = Fraction(1, 10)
H2_DENSITY = 2.0  # one-sided, of white noise of intensity one
NORMS = ("H2", "Hinf")
FAMILIES = {"single": "One vertex", "uncertain": "Two entries of A uncertain by 10 %"}

Matrices = dict[str, Any]


def read(path: Path) -> Matrices:
    """Return the matrices of a file."""
    if path.suffix == ".npz":
        with np.load(path, allow_pickle=False) as data:
            return {key: np.atleast_2d(data[key]).astype(float) for key in KEYS}
    from scipy.io import loadmat

    data = loadmat(path)
    return {key: np.atleast_2d(data[key]).astype(float) for key in KEYS}


def family(name: str, own: Matrices, uncertain: bool) -> UncertainPlant:
    """Return the plant, its entries of largest magnitude multiplied by factors where uncertain."""
    A = [[Fraction(a) for a in row] for row in own["A"].tolist()]
    places, parameters = [], list[Parameter]()
    if uncertain:
        order = np.argsort(-np.abs(own["A"]), axis=None, kind="stable")[:2]
        places = [divmod(int(k), len(A)) for k in order]
        parameters = [Parameter(f"f{k + 1}", 1 - SPREAD, 1 + SPREAD) for k in range(2)]
    vertices = []
    for corner in np.ndindex((2,) * len(places)):
        M = [list(row) for row in A]
        for (i, j), high in zip(places, corner, strict=True):
            M[i][j] *= 1 + SPREAD if high else 1 - SPREAD
        vertices.append(System(tuple(map(tuple, M)), own["B"].tolist(), own["B1"].tolist()))
    rows = zip(own["C1"].tolist(), own["D12"].tolist(), own["D11"].tolist(), strict=True)
    z = [Output(f"z{k + 1}", C=C, D=D, F=F) for k, (C, D, F) in enumerate(rows) if any(C + D + F)]
    y = [Output(f"y{k + 1}", C=C) for k, C in enumerate(own["C"].tolist()) if any(C)]
    return UncertainPlant(tuple(vertices), tuple(parameters), name, outputs=(*z, *y))


def norm(plant: UncertainPlant, which: str) -> Specification:
    """Return the norm from w to z."""
    z = tuple(own.name for own in plant.outputs if own.name.startswith("z"))
    return Rms(z, density=H2_DENSITY) if which == "H2" else Gain(z)


def row(path: str, uncertain: bool) -> dict[str, Any]:
    """Return what is found of a plant: bound, what it is above the worst sample, seconds."""
    own = read(Path(path))
    plant = family(Path(path).stem, own, uncertain)
    measured = tuple(each.name for each in plant.outputs if each.name.startswith("y"))
    found: dict[str, Any] = {}
    for which in NORMS:
        start = time.perf_counter()
        try:
            asked = norm(plant, which)
            best = optimise(plant, asked, structure=Structure(measured=measured, schedule=()))
            took, level = time.perf_counter() - start, best.bounds[0].level
            above = level / sampled(best.plant, best.law, asked).worst - 1
            found[which] = [level, above, took, bool(best.bounded_by)]
        except PolefenceError as error:
            found[which] = str(error)
    return found


def apart(path: Path, uncertain: bool) -> dict[str, Any]:
    """Return a row that is made in a process of its own."""
    with ProcessPoolExecutor(1) as pool:
        try:
            return pool.submit(row, str(path), uncertain).result()
        except Exception as error:  # also of a process that died: the table goes on
            return dict.fromkeys(NORMS, f"{type(error).__name__}: {error}")


def left_out(own: Matrices, states: int) -> str:
    """Return why a plant is left out; empty where it is not."""
    if np.any(own["D21"]):
        return "D21 not zero"
    if not np.any(own["B1"]):
        return "B1 zero"
    return f"More than {states} states" if len(own["A"]) > states else ""


def cells(found: Any) -> list[str]:
    """Return bound, what it is above samples [%], and seconds."""
    if isinstance(found, str):
        return ["-", "-", "-"]
    level, above, took, bounded = found
    return [f"{level:.5g}{'*' if bounded else ''}", f"{100 * above:.2g}", f"{took:.1f}"]


def main() -> None:
    """Print two tables, and what was left out."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plants", type=Path, required=True, help="folder of NAME.mat, NAME.npz")
    parser.add_argument("--results", type=Path, help="file of rows that are done, and to add to")
    parser.add_argument("--states", type=int, default=12, help="most states of a plant")
    parser.add_argument("--only", action="append", help="name of a plant")
    parser.add_argument("--family", action="append", choices=FAMILIES)
    options = parser.parse_args()
    paths = {p.stem: p for p in sorted(options.plants.iterdir()) if p.suffix in (".mat", ".npz")}
    data = {k: read(p) for k, p in paths.items() if not options.only or k in options.only}
    if not data:
        parser.error(f"no plants in {options.plants}")
    out = {name: why for name, own in data.items() if (why := left_out(own, options.states))}
    done = {}
    if options.results and options.results.exists():
        done = json.loads(options.results.read_text())
    for kind in options.family or FAMILIES:
        print(f"\n{FAMILIES[kind]}\n")
        print("| plant | n, m, r | H2 | above [%] | s | Hinf | above [%] | s |")
        print("|---|---|--:|--:|--:|--:|--:|--:|")
        for name in [k for k in data if k not in out]:
            key = f"{name} {kind}"
            if key not in done:
                done[key] = apart(paths[name], kind == "uncertain")
                if options.results:
                    options.results.write_text(json.dumps(done, indent=1))
            own = data[name]
            sizes = f"{len(own['A'])}, {own['B'].shape[1]}, {len(own['C'])}"
            found = [cell for which in NORMS for cell in cells(done[key][which])]
            print(f"| {' | '.join([name, sizes, *found])} |", flush=True)
            for which in NORMS:
                if isinstance(done[key][which], str):
                    print(f"{key} {which}: {done[key][which]}", file=sys.stderr)
    print("\n\\* what bounded the gain is the search's own bound on the speed of poles.\n")
    for why in dict.fromkeys(out.values()):
        print(f"{why}: {', '.join(name for name, own in out.items() if own == why)}.")


if __name__ == "__main__":
    main()
