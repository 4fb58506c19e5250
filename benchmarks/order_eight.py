"""The published active suspension: the optimal law of full order, and ours, while the mass varies.

python benchmarks/order_eight.py

Of handling, the law of order 8 is the central one of two Riccati equations (Doyle, Glover,
Khargonekar & Francis, 1989) at 1.01 times the least gain. Prints the gain of both laws for the
nominal mass, and the worst of masses within 20 %: of ours as it is proved for all of them.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from published_suspension import designed, spec

import polefence as pf

SIGNALS = ("weighted force demand", "weighted deflection", "weighted acceleration")
SENSORS = ("deflection sensor", "acceleration sensor")
MASSES = np.linspace(240, 360, 241)
FREQUENCIES = np.geomspace(1e-2, 1e4, 4000)

Matrices = tuple[Any, ...]  # A, B1, B2, C1, D12, C2, D21


def weights(mass: float) -> Any:
    """Return the weights of the vertices of 240 and 360 kg."""
    share = (1 / mass - 1 / 240) / (1 / 360 - 1 / 240)
    return np.array([[1 - share, share]])


def generalised(plant: pf.UncertainPlant, mass: float) -> Matrices:
    """Return the plant with its weights at a mass."""
    alpha = weights(mass)
    A, B2 = (M[0] for M in plant.at(alpha))
    B1 = plant.driven(alpha)[0]

    def rows(names: tuple[str, ...]) -> Matrices:
        each = [plant.signal(name).arrays(plant) for name in names]
        return tuple(np.stack([(alpha @ y[k])[0] for y in each]) for k in range(3))

    (C1, D12, _), (C2, _, D21) = rows(SIGNALS), rows(SENSORS)
    return A, B1, B2, C1, D12, C2, D21


def central(matrices: Matrices, gamma: float) -> Matrices | None:
    """Return the central law A, B, C of a level; None where there is none."""
    A, B1, B2, C1, D12, C2, D21 = matrices
    R, S = np.linalg.inv(D12.T @ D12), np.linalg.inv(D21 @ D21.T)
    try:
        X = _riccati(
            A - B2 @ R @ D12.T @ C1,
            B1 @ B1.T / gamma**2 - B2 @ R @ B2.T,
            C1.T @ (np.eye(len(C1)) - D12 @ R @ D12.T) @ C1,
        )
        Y = _riccati(
            (A - B1 @ D21.T @ S @ C2).T,
            C1.T @ C1 / gamma**2 - C2.T @ S @ C2,
            B1 @ (np.eye(B1.shape[1]) - D21.T @ S @ D21) @ B1.T,
        )
    except np.linalg.LinAlgError:
        return None
    smallest = min(np.linalg.eigvalsh(M).min() / np.abs(M).max() for M in (X, Y))
    if smallest < -1e-8 or np.abs(np.linalg.eigvals(X @ Y)).max() >= gamma**2:
        return None
    F, L = -R @ (B2.T @ X + D12.T @ C1), -(B1 @ D21.T + Y @ C2.T) @ S
    Z = np.linalg.inv(np.eye(len(A)) - Y @ X / gamma**2)
    worst = B1.T @ X / gamma**2
    return A + B1 @ worst + B2 @ F + Z @ L @ (C2 + D21 @ worst), -Z @ L, F


def _riccati(A: Any, W: Any, Q: Any) -> Any:
    """Return the stabilising X of A'X + X A + X W X + Q = 0."""
    n = len(A)
    H = np.block([[A, W], [-Q, -A.T]])
    values, vectors = np.linalg.eig(H)
    stable = vectors[:, values.real < 0]
    if stable.shape[1] != n or np.abs(values.real).min() < 1e-9 * np.abs(values).max():
        raise np.linalg.LinAlgError
    X = np.real(stable[n:] @ np.linalg.inv(stable[:n]))
    return (X + X.T) / 2


def gain(matrices: Matrices, law: Matrices) -> float:
    """Return the gain of the loop on a grid; infinite where it is not stable."""
    A, B1, B2, C1, D12, C2, D21 = matrices
    a, b, c = law
    N = np.block([[A, B2 @ c], [b @ C2, a]])
    if np.linalg.eigvals(N).real.max() >= 0:
        return np.inf
    E, C = np.vstack([B1, b @ D21]), np.hstack([C1, D12 @ c])
    s = 1j * FREQUENCIES[:, None, None] * np.eye(len(N))
    return float(np.linalg.norm(C @ np.linalg.solve(s - N, E + 0j), 2, axis=(1, 2)).max())


def least(matrices: Matrices) -> float:
    """Return the least level that has a law."""
    low, high = 0.1, 10.0
    while high / low > 1 + 1e-7:
        middle = (low * high) ** 0.5
        low, high = (low, middle) if central(matrices, middle) else (middle, high)
    return high


def main() -> None:
    """Print a table."""
    text = spec("handling", family=True, unmodelled=False)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "spec.toml")
        path.write_text(text)
        plant = pf.load(path)
    nominal, family = generalised(plant, 300), [generalised(plant, m) for m in MASSES]
    optimum = least(nominal)
    law = central(nominal, 1.01 * optimum)
    if law is None:
        raise SystemExit("no central law at 1.01 times the least level")
    print(f"handling: the least gain of any law is {optimum:.4f}")
    print(f"{'':26}{'300 kg':>10}{'240 to 360 kg':>16}")
    worst = max(gain(matrices, law) for matrices in family)
    print(f"{'order 8, central':26}{gain(nominal, law):>10.4f}{worst:>16.4f}  sampled")
    done, asked = designed(text)
    own = float(asked.values(done.plant, done.law, weights(300)).max())
    print(f"{'ours, order 3':26}{own:>10.4f}{float(done.bounds[0].level):>16.4f}  proved")


if __name__ == "__main__":
    main()
