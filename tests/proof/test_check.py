"""One check of a file: counts, places and reasons are fields of its verdicts."""

from __future__ import annotations

import copy
import json

import pytest

from polefence.proof.document import KINDS, check, from_plain
from polefence.proof.work import FormatError


@pytest.fixture(scope="module")
def signals(every_file):
    return json.loads((every_file / "signals" / "design.json").read_text())


def test_counts_are_those_of_the_claims(signals):
    found = check(from_plain(signals))
    assert found.proved
    assert [verdict.claim for verdict in found.verdicts] == list(range(1, 7))
    counts = [verdict.count for verdict in found.verdicts]
    assert all(count > 0 for count in counts)
    document = from_plain(signals)
    assert counts == [len(list(claim.blocks())) for claim in document.claims]
    assert found.reason == f"{sum(counts)} inequalities positive definite in exact arithmetic"
    assert len(found.claims) == 6


def test_where_it_fails(signals):
    """The claim, the inequality, the coefficient."""
    document = copy.deepcopy(signals)
    kinds = [claim["kind"] for claim in document["claims"]]
    number = kinds.index("energy peak") + 1
    document["claims"][number - 1]["level"] = 1e-3
    found = check(from_plain(document))
    last = found.verdicts[-1]
    assert (found.answer, len(found.verdicts), last.claim) == ("undecided", number, number)
    assert last.place.inequality == "of the output"
    assert found.reason == f"claim {number}, energy peak: {last.reason}"
    assert str(last.place) in last.reason
    assert len(found.claims) == 1
    blocks = list(from_plain(document).claims[number - 1].blocks())
    assert blocks[last.count][0] == last.place  # all before it hold


def test_another_output_of_a_name_is_named(signals):
    document = copy.deepcopy(signals)
    document["claims"][1]["name"] = "v"
    found = check(from_plain(document))
    assert found.answer == "undecided"
    assert "the output called 'v' is another of the plant's" in found.reason
    document["plant"]["states"] = ["x [m]", "x [m]"]  # which names neither
    document["claims"][1]["name"] = "x"
    assert check(from_plain(document)).proved


def test_every_kind_is_written_as_it_was_read(every_file):
    seen = set()
    for path in every_file.rglob("*.json"):
        data = json.loads(path.read_text())
        if data.get("format") != "polefence-proof":
            continue
        document = from_plain(data)
        assert from_plain(document.write()) == document
        assert document.write() == data
        seen |= {claim.kind for claim in document.claims}
    assert seen == set(KINDS)


@pytest.mark.parametrize("name", ["design", "performance", "service", "table", "export"])
def test_what_version_1_wrote_is_refused(name):
    with pytest.raises(FormatError, match=r"polefence 0\.1, which is not read any more; design or"):
        from_plain({"format": f"polefence-{name}", "version": 1})


def test_claims_need_a_law(signals):
    without = {key: value for key, value in signals.items() if key != "law"}
    with pytest.raises(FormatError, match="needs a law"):
        from_plain(without)
    with pytest.raises(FormatError, match="1 to 100 entries"):
        from_plain(signals | {"claims": []})
