"""Covariances of a loop: Lyapunov matrices that are as large as what moves the states."""

from __future__ import annotations

import warnings

import numpy as np

from polefence.lmi.conditions.performance import Noise, Points, Source
from polefence.plant.polynomial import Domain, binomial
from polefence.plant.system import Array

SHAKEN = 1e-6  # of the mean intensity, in all states alike, so that the covariance is not singular


def intensity(source: Source, domain: Domain) -> Array:
    """Return what a source moves the states with, in the middle of the family, (n, n)."""
    if isinstance(source, Noise):
        each = [P / binomial(domain.sizes, e) for e, P in source.EE.items()]
        return np.asarray(np.mean(each, axis=0))
    if isinstance(source, Points):
        means = [p.mean(axis=0) for p in source.points]
        own = [] if source.ellipsoid is None else [source.ellipsoid]
        return np.asarray(sum([x @ x.T for x in means] + own))
    E = source.E.mean(axis=0)
    return np.asarray(E @ E.T)


def covariance(F: Array, Q: Array | None = None) -> Array | None:
    """Return the covariance that noise leaves x' = F x in; None if there is none in floats.

    Parameters
    ----------
    F : (n, n) array
    Q : (n, n) array, optional
        Intensity of the noise; by default the identity in balanced states.
    """
    from scipy.linalg import matrix_balance, solve_continuous_lyapunov  # deferred: slow to import

    n = len(F)
    balanced, (scale, _) = matrix_balance(F, permute=False, separate=True)
    own = np.eye(n) if Q is None else Q / np.outer(scale, scale)
    own = own + SHAKEN * np.trace(own) / n * np.eye(n)
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")  # of what is nearly singular: judged below
            X = solve_continuous_lyapunov(balanced, -own)
    except (np.linalg.LinAlgError, ValueError):
        return None
    X = (X + X.T) / 2 * np.outer(scale, scale)
    return np.asarray(X) if np.all(np.isfinite(X)) and np.all(np.diag(X) > 0) else None
