"""Loops of which parameters move, in floats: what files claim along motions, held against samples.

A motion repeats: parameters go up and down at their largest rates, or jump where any rate is
allowed. Over one period the state is multiplied by a matrix, whose eigenvalues say how fast it
decays; pulses, noise and sine waves along it give signals from below.
"""

import numpy as np

TERMS = 9  # of exponentials of what is small
STEPS = 80  # of one period
MARGIN = 1.02  # of steps in which parameters stay where they are


def number(value):
    """The double of a file's number."""
    if isinstance(value, str):
        top, _, bottom = value.partition("/")
        return int(top) / int(bottom or 1)
    return float(value)


def motions(plant, law, count=3):
    """Yield dt, and A + B K, E and alpha at every step of one period, of some motions."""
    ends = np.array([[low, high] for low, high, _ in plant.ranges])
    middle = plant.alpha(ends.mean(axis=1))
    A, B, _ = next(plant.near(middle))
    own = np.abs(np.linalg.eigvals(A + B @ law.gain(middle))).max()
    for _ in range(count):
        fast = 0.05 / max(own, 1e-3) * plant.random.uniform(0.3, 3)
        dt = plant.T or fast
        period = STEPS if not plant.T else int(plant.random.integers(2, 40)) * 2
        shifts = plant.random.uniform(0, 2 * np.pi, len(ends))
        beats = plant.random.integers(1, 4, len(ends))
        p, steps = ends.mean(axis=1), []
        for k in range(2 * period):  # the first period only leads to the one that repeats
            up = np.sin(2 * np.pi * beats * k / period + shifts) > 0
            for f, rate in enumerate(plant.rates):
                if rate == "any":
                    p[f] = ends[f, int(up[f])]
                elif rate is not None:
                    p[f] = np.clip(p[f] + dt * rate[int(up[f])], *ends[f])
            if k >= period:
                alpha = plant.alpha(p)
                A, B, E = next(plant.near(alpha))
                steps.append((A + B @ law.gain(alpha), E + B @ law.passing(alpha), alpha))
        yield dt, steps


def moved(steps, dt, discrete):
    """What each step makes of the state, of an input that is held, and the noise that it adds."""
    loops, E = (np.stack([step[k] for step in steps]) for k in (0, 1))
    n, q = E.shape[1:]
    if discrete:
        return loops, E, E @ E.swapaxes(1, 2) / dt
    above = np.concatenate([loops, E], axis=2)
    held = exponential(np.pad(above, ((0, 0), (0, q), (0, 0))) * dt)
    none = np.zeros_like(loops)
    above = np.concatenate([-loops, E @ E.swapaxes(1, 2)], axis=2)
    both = exponential(
        np.concatenate([above, np.concatenate([none, loops.swapaxes(1, 2)], axis=2)], axis=1) * dt
    )
    step = both[:, n:, n:].swapaxes(1, 2)
    return step, held[:, :n, n:], step @ both[:, :n, n:]


def exponential(M):
    """The exponentials of small matrices (count, n, n)."""
    term = found = np.eye(M.shape[1]) + 0 * M
    for k in range(1, TERMS):
        term = term @ M / k
        found = found + term
    return found


def false_decay(plant, law, decay=None, factor=None):
    """Whether a motion decays more slowly: in continuous time, or by a factor each sample."""
    for dt, steps in motions(plant, law):
        whole = np.eye(len(steps[0][0]))
        for step in moved(steps, dt, plant.T)[0]:
            whole = step @ whole
        grown = np.abs(np.linalg.eigvals(whole)).max() ** (1 / len(steps))
        limit = factor if decay is None else np.exp(-decay * dt)
        if grown > limit * (1 + 1e-3 * abs(1 - limit)) + 1e-9:
            return True
    return False


def false_signal(plant, law, claim, rows):
    """Whether a signal is more along a motion; ``rows`` gives its rows of (x, w) at alpha."""
    level, kind = number(claim["level"]) * MARGIN + 1e-9, claim["kind"]
    scales = np.array([number(x) for x in claim["disturbances"]]) if "disturbances" in claim else 1
    for dt, steps in motions(plant, law, 1):
        if _reached(kind, claim, dt, steps, rows, scales, plant.T) > level:
            return True
    return False


def _reached(kind, claim, dt, steps, rows, scales, discrete):
    n, q = steps[0][1].shape
    P, worst = np.zeros((n, n)), 0.0
    starts = [np.array(list(map(number, p))) for p in claim.get("points", [])]
    sizes = [number(s) / (dt if discrete else 1) for s in claim.get("impulses", [])]
    starts += [s * steps[0][1][:, k] for k, s in enumerate(sizes) if not discrete]
    x = np.array(starts).T if starts else np.zeros((n, 1))
    w = np.sin(np.multiply.outer(dt * np.arange(3 * len(steps)), np.geomspace(0.01, 1, 6) / dt))
    waves, spent, got = np.zeros((n, 6)), np.zeros(6), np.zeros(6)
    each = list(zip(*moved([(A, E * scales) for A, E, _ in steps], dt, discrete), strict=True))
    outputs = [rows(alpha) for _, _, alpha in steps]
    for k in range(3 * len(steps)):
        (step, push, noise), (C, F) = each[k % len(steps)], outputs[k % len(steps)]
        if kind == "rms":
            size = number(claim.get("intensity", 1))
            worst = max(worst, np.sqrt(max(size * np.trace(C @ P @ C.T), 0.0)))
        elif kind == "energy peak":
            size = number(claim.get("norm", 1))
            worst = max(worst, size * np.sqrt(max(np.linalg.eigvalsh(C @ P @ C.T)[-1], 0.0)))
        elif kind == "initial peak":
            worst = max(worst, float(np.abs(C @ x).max()))
        elif kind == "gain":
            drive = np.ones((q, 1)) / np.sqrt(q) * w[k]
            y = C @ waves + (F * scales) @ drive
            spent, got = spent + (drive**2).sum(axis=0), got + (y**2).sum(axis=0)
            waves = step @ waves + push @ drive
        P, x = step @ P @ step.T + noise, step @ x
    return float(np.sqrt(np.max(got / np.maximum(spent, 1e-12)))) if kind == "gain" else worst
