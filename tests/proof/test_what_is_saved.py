"""Whatever a command calls proved and saves, the checker alone proves: of 60 random plants."""

from __future__ import annotations

import json
import sys
from dataclasses import replace

import numpy as np
import pytest

from polefence.cli.main import main
from polefence.plant.exact import file_plant
from polefence.plant.spec import load
from polefence.proof import document, work
from polefence.proof.claims.base import prove
from polefence.proof.document import FORMAT, VERSION, check, loads
from polefence.proof.work import FormatError
from support.every_file import quiet
from support.hasty import hasty
from support.lmi_alone import lmi_alone
from support.standalone import many

LATE = ["--sample-time", "0.05", "--delay", "1"]
ONE = ["--schedule", "none"]
QUICK = ["--method", "quadratic"]


def random_spec(source, n, count, *, rate=False, sensors=(), order=None):
    """A chain of n integrators, whose last row is uncertain in so many parameters."""
    last = np.poly(-source.uniform(0.5, 3, n))[:0:-1]
    names = [f"p{k + 1}" for k in range(count)]
    rows = [[int(j == i + 1) for j in range(n)] for i in range(n - 1)]
    rows.append([" * ".join([f"-{x:.3f}", *names[j::n]]) for j, x in enumerate(last)])
    into = [[0]] * (n - 1) + [[1]]
    text = f"""name = "random"
states = {json.dumps([f"x{i + 1} [m]" for i in range(n)])}
inputs = ["u [N]"]
disturbances = ["w [N]"]
region = "half_plane(0.1)"
"""
    for name in names:
        low = source.uniform(0.5, 1)
        text += f"[parameter.{name}]\nrange = [{low:.3f}, {low * source.uniform(1.1, 1.6):.3f}]\n"
        text += "rate = [-1, 1]\n" * rate
    text += f"[matrices]\nA = {json.dumps(rows)}\nB = {into}\nE = {into}\n"
    for name in sensors:
        text += f"[sensor.{name}]\nbandwidth = 20\nnoise = 0.01\n"
    if order is not None:
        text += f"[law]\nmeasured = {json.dumps(list(sensors))}\nschedule = []\norder = {order}\n"
    return (
        text
        + f"""[[specification]]
kind = "rms"
signal = "x1"
density = 1
minimise = true
[[specification]]
kind = "rms"
signal = "u"
density = 1
at_most = {source.uniform(2, 6):.3f}
"""
    )


# How many plants of each kind; states, parameters and more of it; commands, each of which may say
# that it proved nothing, but saves nothing then.
OPTIMISE = ["optimise", "spec.toml", "-o", "design"]
SERVICE = ["service", "design", "-o", "service"]
EXPORT = ["export", "design", "-o", "code"]
LIMIT = ["--limit", "saturation of u <= 5 with norm 1"]
PLACED = ["--region", "half_plane(0.3) & disk(-30, 29.9)", "-o", "design"]
ROWS = ["--value", "3", "--value", "5", "--json", "rows.json"]
KINDS = {
    "tuned": (2, (2, 1), {}, [OPTIMISE, [*EXPORT, "--sample-time", "0.001"]]),
    "one gain": (16, (3, 2), {}, [[*OPTIMISE, *QUICK], SERVICE, EXPORT]),
    "sampled": (2, (2, 1), {}, [[*OPTIMISE, *LATE], EXPORT]),
    "sampled, one gain": (2, (2, 2), {}, [[*OPTIMISE, *LATE, *ONE]]),
    "moving": (2, (2, 1), {"rate": True}, [OPTIMISE]),
    "moving, one gain": (4, (3, 2), {"rate": True}, [[*OPTIMISE, *QUICK], SERVICE]),
    "saturated": (8, (2, 1), {}, [[*OPTIMISE, *QUICK, *LIMIT]]),
    "saturated, moving": (2, (2, 1), {"rate": True}, [[*OPTIMISE, *QUICK, *LIMIT]]),
    "two sensors": (4, (3, 1), {"sensors": ("x1", "x2"), "order": 0}, [OPTIMISE]),
    "a state of its own": (1, (2, 1), {"sensors": ("x1",), "order": 1}, [OPTIMISE, SERVICE]),
    "three parameters": (1, (3, 3), {}, [OPTIMISE, EXPORT]),
    "three, one gain": (4, (4, 3), {}, [[*OPTIMISE, *QUICK], SERVICE]),
    "three, sampled": (1, (2, 3), {}, [[*OPTIMISE, *LATE, *ONE]]),
    "design": (4, (3, 2), {}, [["design", "spec.toml", *PLACED], SERVICE]),
    "design, sampled": (2, (2, 2), {}, [["design", "spec.toml", *LATE, "-o", "design"]]),
    "tightest": (2, (2, 2), {}, [["tightest", "spec.toml", "--of", "half_plane", "-o", "design"]]),
    "observe": (
        2, (3, 2), {},
        [["observe", "spec.toml", "--measured", "x1", "--disk", "-4", "3.8", "-o", "design"]],
    ),
    "verify": (
        2, (2, 2), {},
        [["verify", "spec.toml", "--gain", "[[-1, -1]]", "--limit", "gain of x1", "-o", "design"]],
    ),
    "limits": (
        1, (2, 2), {},
        [["limits", "spec.toml", "--centre", "-3", "--centre", "-5", "--json", "rows.json"]],
    ),
    "tradeoff": (
        2, (2, 2), {},
        [["tradeoff", "spec.toml", "--over", "rms of u with density 1", *QUICK, *ROWS]],
    ),
}  # fmt: skip


def every_spec():
    """The kind and number of each random plant."""
    return [(kind, number) for kind, own in KINDS.items() for number in range(own[0])]


def written(kind, number):
    """Write the spec of a random plant into the working folder."""
    _, shape, options, commands = KINDS[kind]
    source = np.random.default_rng([*map(ord, kind), number])
    with open("spec.toml", "w", encoding="utf-8") as file:
        file.write(random_spec(source, *shape, **options))
    return commands


def files_of_rows(folder):
    """Write each row of a sweep that is proved as the file of claims that it holds."""
    if not (folder / "rows.json").exists():
        return
    rows = json.loads((folder / "rows.json").read_text())["rows"]
    plant = file_plant(load(folder / "spec.toml")).write()
    for number, row in enumerate(own for own in rows if own["answer"] == "proved"):
        if "performance" in row:
            table = row["performance"]
        else:
            own = row["proof"]
            disk = {"kind": "disk", "centre": row["centre"], "radius": row["radius"]}
            claim = {"kind": "region", "region": disk} | {k: own[k] for k in ("method", "evidence")}
            table = {"format": FORMAT, "version": VERSION, "plant": plant, "law": own["law"]}
            table["claims"] = [claim]
        (folder / f"row-{number}.json").write_text(json.dumps(table))


def ran(words, tuned=False):
    """Run a command; unless laws are tuned too, a method finds the law of its LMI alone."""
    with hasty() if tuned or not set(QUICK) <= set(words) else lmi_alone():
        return quiet(words)


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """All files of claims, by the kind of plant; and how many commands proved nothing."""
    made, files, refused = tmp_path_factory.mktemp("saved"), dict[str, list[object]](), []
    with pytest.MonkeyPatch.context() as patch:
        for kind, number in every_spec():
            folder = made / f"{kind} {number}"
            folder.mkdir()
            patch.chdir(folder)
            for words in written(kind, number):
                status, out, err = ran(words, tuned=number == 0)
                assert status in (0, 1), (kind, number, words, err)
                if status:
                    refused.append((kind, number, words[0], err or out))
                    break
                assert "proved" in out
            files_of_rows(folder)
            found = [own for own in folder.rglob("*.json") if f'"{FORMAT}"' in own.read_text()[:99]]
            files.setdefault(kind, []).extend(sorted(found))
    return files, refused


def test_the_checker_alone_proves_what_is_saved(saved, tmp_path):
    files, refused = saved
    assert len(every_spec()) >= 60
    assert len(refused) <= 6, refused
    checker = tmp_path / "polefence-check.pyz"
    assert main(["check", "--standalone", str(checker)]) == 0
    each = [(kind, own) for kind, paths in files.items() for own in paths]
    assert all(files[kind] for kind in KINDS)
    answers = many(checker, [[path] for _, path in each])
    wrong = [(*own, *said) for own, said in zip(each, answers, strict=True) if said[0]]
    assert not wrong


def bounded(patch, most):
    """Let every claim take so much work at most, wherever it is proved."""
    for name, module in list(sys.modules.items()):
        if name.startswith("polefence") and hasattr(module, "MAX_WORK"):
            patch.setattr(module, "MAX_WORK", most)
    patch.setattr(work.counted.__wrapped__, "__defaults__", (most,))
    patch.setattr(document, "MAX_FILE", work.FULL * most)


def works(found):
    """What each claim of a file takes to prove."""
    each = []
    for claim in found.claims:
        with work.counted() as count:
            assert prove(claim).proved
        each.append(count.spent)
    return each


@pytest.mark.parametrize("kind", ["one gain", "three, one gain", "sampled, one gain"])
def test_a_claim_gets_the_same_work_alone_and_in_a_file(kind, tmp_path, monkeypatch):
    """What is called proved under a bound of work is proved under it, however tight the bound."""
    monkeypatch.chdir(tmp_path)
    (words, *_) = written(kind, 0)
    assert ran(words)[0] == 0
    path = tmp_path / "design" / "design.json"
    found = loads(path.read_text())
    each = works(found)
    assert sum(each) > 1.05 * max(each)  # a count for the whole file would refuse it
    bounded(monkeypatch, max(each))
    assert check(found).proved
    bounded(monkeypatch, max(each) - 1)
    with pytest.raises(FormatError):
        check(found)
    answers = set()
    for share in (0.9, 0.5, 0.02):
        bounded(monkeypatch, int(share * max(each)))
        path.unlink(missing_ok=True)
        status, out, err = ran(words)
        answers.add(status)
        assert (status == 0) == path.exists() == ("proved:" in out and "not proved" not in err)
        if path.exists():
            assert check(loads(path.read_text())).proved
    assert answers - {0}


def test_a_file_of_many_claims_is_bounded(tmp_path, monkeypatch):
    """Beyond so many claims they share what a file gets; then all of it is proved beforehand."""
    monkeypatch.chdir(tmp_path)
    assert ran(written("one gain", 0)[0])[0] == 0
    found = loads((tmp_path / "design" / "design.json").read_text())
    most = max(works(found))
    full = replace(found, claims=found.claims[1:2] * work.FULL)
    more = replace(found, claims=found.claims[1:2] * (work.FULL + 2))
    bounded(monkeypatch, most)
    monkeypatch.setattr(document, "MAX_FILE", works(full)[0] * work.FULL)
    full.require_checkable(full.claims)
    with pytest.raises(FormatError, match="to be checked here"):
        more.require_checkable(more.claims)
    with pytest.raises(FormatError, match="to be checked here"):
        check(more)
