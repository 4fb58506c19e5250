"""Methods without the laws that are tuned from theirs: for what comes before and after a search."""

from contextlib import contextmanager

import pytest

from polefence.search import optimise as search


@contextmanager
def lmi_alone():
    """Have a method find the law of its LMI, or none: no law is tuned, which takes the longest."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(search, "_best_tuned", lambda *_: None)
        yield
