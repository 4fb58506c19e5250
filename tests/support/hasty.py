"""Searches that end early: for tests of what is done with a law, however good it is."""

from __future__ import annotations

from contextlib import contextmanager

import numpy as np
import pytest

from polefence.search.tune import tuner
from polefence.search.tune.descent import FULL, PENALTY, Effort, descend

STARTS = 4  # of a search
SHORT = Effort(10, 1e-2)


def _short(evaluate, theta, target=-np.inf, effort=FULL, penalty=PENALTY):
    most = effort if np.isfinite(target) else SHORT
    return descend(evaluate, theta, target, most, penalty)


@contextmanager
def hasty():
    """Have laws be tuned from few starts in few steps: they are worse, and proved as any.

    What leads into a region and to the limits, and ends there, goes on as long as it does.
    """
    starts = tuner._Search._starts

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tuner._Search, "_starts", lambda own, laws: starts(own, laws)[:STARTS])
        patch.setattr(tuner, "descend", _short)
        patch.setattr(tuner, "BEST", 1)
        patch.setattr(tuner, "LAST", 1)
        yield
