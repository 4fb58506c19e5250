"""One fault at a time into a design file: what fails is refused, what is harmless passes.

For every change the truth is decided independently of the checker's integer elimination: in
floats, from numpy eigenvalues of the blocks, leaving out changes too close to call.
"""

from __future__ import annotations

import json
import random

import numpy as np
import pytest

from polefence import check
from polefence.cli.main import main
from polefence.proof import work
from polefence.proof.claims.base import prove
from polefence.proof.document import loads
from support.changes import entries, least_eigenvalue, scaled
from support.files import first, poles_in

CHANGES = 120


def is_disk(document):
    """Whether the region is still one; what is none is bad input."""
    centre, radius = (first(document)["region"][key] for key in ("centre", "radius"))
    return radius > 0 and (centre < 0 or centre + radius < 1)


@pytest.mark.parametrize("method", ["quadratic", "slack", "scheduled", "right-hand sides"])
def test_seeded_changes(small_designs, method):
    original = json.loads(small_designs[method].certificate.dumps())
    places = entries(original)
    dice = random.Random(method)
    answers = {True: 0, False: 0}
    for _ in range(CHANGES):
        size = 10.0 ** dice.uniform(-12, 1) * dice.choice([-1, 1])
        tried = scaled(original, dice.choice(places), 1 + size, dice.choice([0, size]))
        if not is_disk(tried):
            with pytest.raises(work.FormatError, match="region"):
                loads(json.dumps(tried))
            continue
        claim = poles_in(json.dumps(tried))
        least = least_eigenvalue(claim)
        if abs(least) < 1e-9:
            continue
        assert prove(claim).proved is bool(least > 0)
        answers[bool(least > 0)] += 1
    assert min(answers.values()) >= 10, answers  # both kinds were met


@pytest.mark.parametrize("method", ["quadratic", "slack", "scheduled"])
def test_every_single_number_matters(small_designs, method):
    """A change of each entry that is large enough to break the claim is refused."""
    original = json.loads(small_designs[method].certificate.dumps())
    for path in entries(original):
        for factor, shift in ((1, 1e4), (1, -1e4), (0, -50), (0.1, 0)):
            tried = scaled(original, path, factor, shift)
            if not is_disk(tried):
                continue
            claim = poles_in(json.dumps(tried))
            if least_eigenvalue(claim) < -1e-9:
                assert not prove(claim).proved, path
                break
        else:
            assert path in {("claims", 0, "evidence", "tau")}, path  # zero without right-hand sides


def test_the_paper_design_with_changes_through_the_command_line(placed, tmp_path, capsys):
    """The five-state car: exit 1 for every broken claim, 0 for every harmless change."""
    path = placed.save(tmp_path)
    original = json.loads(path.read_text())
    for key in ("outputs", "vehicle"):  # which say of the vertices what they are
        del original["plant"][key]
    dice = random.Random(31)
    broken = harmless = 0
    while broken < 12 or harmless < 6:
        size = 10.0 ** dice.uniform(-15, 0) * dice.choice([-1, 1])
        tried = scaled(original, dice.choice(entries(original)), 1 + size, 0)
        if not is_disk(tried):
            path.write_text(json.dumps(tried))
            assert main(["check", str(path)]) == 2
            continue
        least = least_eigenvalue(poles_in(json.dumps(tried)))
        if tried == original or abs(least) < 1e-10:
            continue
        path.write_text(json.dumps(tried))
        assert main(["check", str(path)]) == (0 if least > 0 else 1)
        answer = capsys.readouterr().out
        assert ("proved: " in answer.replace("not proved", "")) is bool(least > 0)
        broken, harmless = broken + (least < 0), harmless + (least > 0)


def test_a_last_digit_is_harmless(placed, tmp_path):
    path = placed.save(tmp_path)
    document = json.loads(path.read_text())
    for j in range(4):
        document["law"]["Z"][j][0][0] = np.nextafter(document["law"]["Z"][j][0][0], 0)
    path.write_text(json.dumps(document))
    assert check(path).proved
