"""Drives of the van whose computer's periods are random, beside what is proved for any of them.

``python docs/examples/clock_drives.py`` prints the page's numbers; it takes a few minutes. The law
is the best single gain of the two sensors at 2 ms, half a sample late. Each of 1,000 drives of 30 s
is over a random road, at the corner of the box that is worst, with periods drawn evenly from all
that the clock may have. States go from sample to sample as exponentials say, with the noise that
the road adds; between samples the mean square is that which is expected.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

import polefence as pf
from polefence.requirements.specification import delta_form
from polefence.response.closed import close

SPEC = Path(pf.examples.__file__).with_name("van.toml")
T, LATE, JITTERS = 0.002, 0.5, (0.0, 0.05)  # s; samples; shares of the period
DRIVES, LONG, LENGTHS, SEED = 1000, 30.0, 41, 49  # LENGTHS: of periods that are drawn from


def designed(jitter):
    """The best gain for a clock, and what is minimised."""
    plant, least = pf.load(SPEC), pf.load_specifications(SPEC)
    structure = replace(pf.load_structure(SPEC), order=0)
    seen = pf.at_sample_time(plant, T, LATE, jitter=jitter)
    return pf.optimise(seen, *least, structure=structure), least[0]


def driven(done, asked, jitter):
    """The rms of each drive over random periods, at the corner that is worst."""
    plant = delta_form(done.plant)
    worst = int(asked.values(done.plant, done.law, np.eye(8)).argmax())
    corner = np.eye(8)[worst : worst + 1]
    K = close(plant, done.law, corner).K[0]
    lengths = 1 + jitter * np.linspace(-1, 1, LENGTHS if jitter else 1)
    every = [asked.over(plant, corner, length) for length in lengths]
    A = np.stack([np.eye(len(one.A[0])) + T * (one.A[0] + one.B[0] @ K) for one in every])
    E = np.stack([T**0.5 * one.E[0] for one in every])
    C = np.stack([one.C[0] + one.D[0] @ K for one in every])
    more = np.array([float(one.more[0]) for one in every])
    random = np.random.default_rng(SEED)
    x, energy, time = np.zeros((DRIVES, A.shape[1])), np.zeros(DRIVES), np.zeros(DRIVES)
    for k in range(-round(5 / T), round(LONG / T)):  # five seconds until it rides as it always does
        which = random.integers(len(lengths), size=DRIVES)
        if k >= 0:
            shown = np.einsum("dij,dj->di", C[which], x)
            energy += lengths[which] * ((shown**2).sum(axis=1) + more[which])
            time += lengths[which]
        noise = random.standard_normal((DRIVES, E.shape[2]))
        x = np.einsum("dij,dj->di", A[which], x) + np.einsum("dij,dj->di", E[which], noise)
    return np.sqrt(energy / time)


def main():
    """Design, drive and print."""
    for jitter in JITTERS:
        done, asked = designed(jitter)
        rms = driven(done, asked, jitter)
        print(
            f"{100 * jitter:g} % of jitter: {done.bounds[0].level:.4f} proved; {DRIVES} drives "
            f"{(rms**2).mean() ** 0.5:.4f}, standard deviation {rms.std() / DRIVES**0.5:.4f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
