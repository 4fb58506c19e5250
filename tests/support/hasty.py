"""Searches that end early: for tests of what is done with a law, however good it is."""

from __future__ import annotations

from contextlib import contextmanager

import numpy as np
import pytest

from polefence.search.tune import tuner
from polefence.search.tune.descent import FULL, PENALTY, Effort, descend, descent

STARTS = 4  # of a search
SHORT = Effort(10, 1e-2)


def _most(target, effort):
    return effort if np.isfinite(target) else SHORT


def _descend(evaluate, theta, target=-np.inf, effort=FULL, penalty=PENALTY):
    return descend(evaluate, theta, target, _most(target, effort), penalty)


def _descent(theta, target=-np.inf, effort=FULL, penalty=PENALTY):
    return descent(theta, target, _most(target, effort), penalty)


@contextmanager
def hasty():
    """Have laws be tuned from few starts in few steps: they are worse, and proved as any.

    What leads into a region and to the limits, and ends there, goes on as long as it does.
    """
    starts = tuner._Search._starts

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tuner._Search, "_starts", lambda own, laws: starts(own, laws)[:STARTS])
        patch.setattr(tuner, "descend", _descend)
        patch.setattr(tuner, "descent", _descent)
        patch.setattr(tuner, "BEST", 1)
        patch.setattr(tuner, "LAST", 1)
        yield
