"""Norms of one large plant, proved, beside the same norms in floats by python-control.

python benchmarks/large.py [FILE.mat]

Without a file the plant is made up: 135 modes of 0.5 %
damping, 0.5 to 60 rad/s, with random shapes of 3 inputs and 3 outputs. Prints seconds and ratios.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable
from typing import Any

import control
import numpy as np
import scipy.io

import polefence as pf
from polefence.plant.outputs import Output


def made_up(modes: int = 135, seed: int = 3) -> tuple[Any, Any, Any]:
    """Return A, B and C in modal coordinates."""
    random = np.random.default_rng(seed)
    w, none = np.geomspace(0.5, 60, modes), np.zeros((modes, modes))
    A = np.block([[none, np.eye(modes)], [-np.diag(w**2), -np.diag(2 * 0.005 * w)]])
    shapes = [random.normal(size=(modes, 3)) for _ in range(2)]
    return A, np.vstack([np.zeros((modes, 3)), shapes[0]]), np.hstack([shapes[1].T, none[:3]])


def read(path: str) -> tuple[Any, Any, Any]:
    """Return A, B and C of a file, dense."""
    whole = scipy.io.loadmat(path)
    dense = (whole[key] for key in "ABC")
    A, B, C = (np.asarray(M.toarray() if hasattr(M, "toarray") else M, dtype=float) for M in dense)
    return A, B, C


def in_floats(A: Any, B: Any, C: Any, p: Any) -> float:
    """Return a norm of the same system by python-control."""
    return float(control.system_norm(control.ss(A, B, C, 0), p))


def timed(run: Callable[[], Any]) -> tuple[Any, float]:
    """Return what a function returns, and its seconds."""
    start = time.perf_counter()
    return run(), time.perf_counter() - start


def main() -> None:
    """Print a table."""
    A, B, C = read(sys.argv[1]) if len(sys.argv) > 1 else made_up()
    n, m = B.shape
    names = [f"y{i + 1}" for i in range(len(C))]
    outputs = tuple(Output(name, "", C=[row.tolist()]) for name, row in zip(names, C, strict=True))
    plant = pf.UncertainPlant.from_vertices([A], [B], [B], outputs=outputs)
    decay = -np.linalg.eigvals(A).real.max()
    none, region = np.zeros((m, n)), pf.HalfPlane(0.99 * decay)
    poles, seconds = timed(lambda: pf.analyse(plant, none, region))
    print(f"{n} states, {m} inputs, {len(C)} outputs; poles {poles.answer} in {seconds:.1f} s")
    print("norm       proved       floats  proved/floats  proved [s]  floats [s]  ratio  check [s]")
    kinds = (
        ("rms", pf.Rms(names, density=2), 2),
        ("gain", pf.Gain(names), "inf"),
    )
    for name, limit, p in kinds:
        analysis, seconds = timed(
            lambda limit=limit: pf.analyse(plant, none, pf.HalfPlane(0), limits=[limit])
        )
        truth, floats = timed(lambda p=p: in_floats(A, B, C, p))
        level = analysis.bounds[0].bound.level
        with tempfile.TemporaryDirectory() as folder:
            path = analysis.save(folder)
            checked, check = timed(lambda path=path: pf.check(path))
        assert checked.proved
        print(
            f"{name:5}{level:12.7g} {truth:12.7g} {level / truth:14.6f} {seconds:11.1f} "
            f"{floats:11.2f} {seconds / floats:6.1f} {check:10.1f}"
        )


if __name__ == "__main__":
    main()
