"""Throughput of studies: processes and Dask beside plain batched calls, and what 1,000 would do.

    python benchmarks/fleet.py [--variants N] [--workers 1 2 4]

Three questions about N quarter cars (2,000 by default). "one core" is the same work by batched
calls in this process, in one thread, without any store. The command with processes and with Dask
is timed whole, turn by turn. Needs the extras parquet and cluster.
"""

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from polefence.base.processors import share_processors
from polefence.examples import spec_text
from polefence.fleet import Store, load_study, processes, run
from polefence.fleet.run import Packed, answered

STUDY = """
base = "car.toml"
[variants]
random = {{count = {count}, seed = 1, of = {{m2 = [25, 32], "m1.high" = [300, 380]}}}}
[[question]]
ask = "tightest"
centre = -40
[[question]]
ask = "design"
region = "disk(-40, 33)"
method = "slack"
[[question]]
name = "decay"
ask = "tightest"
of = "half_plane"
"""


TURNS = 3


def timed(work):
    begin = time.perf_counter()
    found = work()
    return time.perf_counter() - begin, found


def memory():
    """Most memory that this process has had [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def studied(study, folder, workers):
    """Run a study; return the client's memory at a tenth of its rows and at their end."""
    early = None
    for done, _ in enumerate(run(study, Store(folder), workers)):
        if early is None and done * 16 > study.total / 10:
            early = memory()
    return early, memory()


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--variants", type=int, default=2000)
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2, 4])
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "car.toml").write_text(spec_text("quarter-car-physical"))
        (folder / "study.toml").write_text(STUDY.format(count=options.variants))
        study = load_study(folder / "study.toml")
        share_processors()
        packed = [Packed.of(study, task) for task in study.tasks()]
        alone, answers = timed(lambda: [answered(own) for own in packed])
        rate = study.total / alone
        print(f"{os.cpu_count()} processors, {study.total} rows")
        print(f"{'':<22}{'rows/s':>8}{'of so many cores':>18}{'client MB':>16}")
        print(f"{'one core':<22}{rate:>8.1f}")
        places = [(f"{n} processes", processes(n), n) for n in options.workers]
        for k, (label, workers, n) in enumerate(places):
            own, (early, late) = timed(lambda w=workers, k=k: studied(study, folder / f"{k}", w))
            cores = min(n, os.cpu_count())
            share = study.total / own / (rate * cores)
            print(f"{label:<22}{study.total / own:>8.1f}{share:>18.2f}{early:>8.0f}{late:>8.0f}")
        ratios = []
        for turn in range(TURNS):
            own, other = (
                timed(lambda m=more, t=turn: command(folder, f"{t}{len(m)}", m))[0]
                for more in ((), ("--cluster", "local"))
            )
            ratios.append(other / own)
        said = ", ".join(f"{ratio:.2f}" for ratio in sorted(ratios))
        print(f"the whole command with Dask over that with processes: {said}")
        client, _ = timed(lambda: kept(study, folder / "kept", packed, answers))
        print(f"the client alone keeps {study.total / client:.0f} rows a second: by that")
        for n in (10, 100, 1000):
            print(f"  {n:>5} workers: {min(n * rate, study.total / client):>8.0f} rows/s")


def command(folder, name, more):
    words = [sys.executable, "-m", "polefence", "study", folder / "study.toml"]
    words += ["-o", folder / f"command{name}", *more]
    subprocess.run(words, stdout=subprocess.DEVNULL, check=False)


def kept(study, folder, packed, answers):
    """Do what the client does by itself: read variants, write rows and proofs."""
    store = Store(folder)
    store.folder.mkdir()
    store.begin(study, False)
    for own, found in zip(packed, answers, strict=True):
        Packed.of(study, own.task)
        pairs = zip(own.task.variants, found, strict=True)
        store.add(study, own.task.question, dict(pairs))


if __name__ == "__main__":
    main()
