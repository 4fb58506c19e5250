"""Searches and proofs that several tests ask for, done once: the same question, the same answer."""

import inspect
import sys
from dataclasses import replace
from importlib import import_module

import pytest

from polefence.certify.design import check_document
from polefence.export.sampled import largest_sample_time
from polefence.search import optimise as search
from polefence.search.optimise import optimise
from polefence.search.tune import tuner

CALLERS = (
    "polefence",
    "polefence.cli.optimise",
    "polefence.search.tradeoff",
    "polefence.studio.question",
)


@pytest.fixture(scope="module", autouse=True)
def searched_once():
    """Have `optimise` remember, in the tests of a module: whoever asks for all the same gets the
    same law, and whoever asks for anything else another search.
    """
    known, signature = [], inspect.signature(optimise)

    def remembered(*given, **more):
        bound = signature.bind(*given, **more)
        bound.apply_defaults()
        asked = bound.arguments | {"subject_to": tuple(bound.arguments["subject_to"])}
        asked["tuned"] = search._best_tuned, tuner.descend  # as `lmi_alone` and `hasty` have them
        for before, found in known:
            if before == asked:
                return found
        found = optimise(*given, **more)
        known.append((asked, found))
        return found

    with pytest.MonkeyPatch.context() as patch:
        for name in CALLERS:
            if name.startswith("polefence.studio") and "polefence.studio" not in sys.modules:
                continue  # importing it takes a second
            patch.setattr(import_module(name), "optimise", remembered)
        yield


@pytest.fixture(scope="module", autouse=True)
def proved_once():
    """Have exports remember, in the tests of a module, what takes them long: of a file with the
    same claims, whatever it says of the code beside it, they are proved no second time, and of the
    same design the largest sample time is sought no second time.
    """
    known = {}

    def remembered(document, path):
        claims = replace(document, export=None).dumps()
        if claims not in known:
            known[claims] = check_document(document, path)
        return known[claims]

    def sought(design, delay):
        asked = design.certificate.file().dumps(), delay
        if asked not in known:
            known[asked] = largest_sample_time(design, delay)
        return known[asked]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("polefence.export.documents.check_document", remembered)
        patch.setattr("polefence.export.timing.largest_sample_time", sought)
        yield
