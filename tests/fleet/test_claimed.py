"""Rows whose files are proved, and are about something else than their questions: each is found.

What is lowered in a claim here (noise, a filter, a signal, errors) leaves it provable: a check of
the proof alone has nothing to say against it.
"""

import json
import math
import shutil
import tomllib
from dataclasses import fields, is_dataclass, replace
from fractions import Fraction
from functools import cache
from pathlib import Path

import pytest

from polefence import Disk, place
from polefence.certify.bounds import bounds_file
from polefence.cli.main import main
from polefence.fleet import Store, judged, processes
from polefence.fleet.claimed import bounds, fault_of, is_about
from polefence.fleet.form import Form
from polefence.fleet.questions import read_questions
from polefence.fleet.store import law_of
from polefence.law.structure import Structure
from polefence.plant.spec import loads
from polefence.proof.document import check
from polefence.proof.document import loads as read
from polefence.proof.laws import Evidence, Law
from polefence.proof.reading import as_number, plain
from polefence.requirements.energy_peak import EnergyPeak
from polefence.requirements.gain import Gain
from polefence.requirements.gain_norm import GainNorm
from polefence.requirements.initial_peak import InitialPeak
from polefence.requirements.relative_rms import RelativeRms
from polefence.requirements.rms import Rms
from polefence.requirements.saturation import Saturation
from polefence.requirements.specification import claim_of
from support.commands import ran
from support.studies import put_proof, put_rows, signed

pytest.importorskip("pyarrow")

PLANT = """
states = ["x [m]", "v [m/s]"]
inputs = ["idle [N]", "u [N]"]
disturbances = ["gust [N]", "floor [m]"]
constants = {c = 1, b = 0}
[parameter.m1]
range = [2, 3]
through = "1/m1"
[parameter.k]
range = [1, 2]
[matrices]
A = [[0, 1], ["-k", "-c"]]
B = [["b", 0], [0, "1/m1"]]
E = [[0, 0], ["0.5/m1", "k/2"]]
[outputs.strain]
C = ["k", 0]
[outputs.force]
C = [0, 0]
D = [0, 1]
"""
ASKED = """
[[specification]]
kind = "rms"
signal = ["strain", "x"]
weight = ["Wk", "none"]
density = 0.5
disturbances = {gust = 1.0, floor = 0.5}
minimise = true
[[specification]]
kind = "rms"
signal = "force"
density = 0.5
at_most = 3
"""
STUDY = """
base = "plant.toml"
[variants]
grid = {c = [1]}
[[question]]
ask = "optimise"
method = "quadratic"
region = "disk(-4, 3.9)"
[[question]]
ask = "service"
name = "gain"
region = "disk(-4, 3.9)"
[[question]]
ask = "service"
name = "estimate-m1"
margin = "estimate-m1"
region = "disk(-4, 3.9)"
[[question]]
ask = "service"
name = "estimate-k"
margin = "estimate-k"
region = "disk(-4, 3.9)"
[[question]]
ask = "service"
name = "rate"
margin = "rate"
decay = 0.05
region = "disk(-4, 3.9)"
[[question]]
ask = "tightest"
name = "decay"
of = "half_plane"
within = "disk(-4, 3.9)"
[[question]]
ask = "tightest"
name = "disk"
method = "quadratic"
centre = -4
"""


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """The results of a study of one variant."""
    folder = tmp_path_factory.mktemp("claimed")
    (folder / "plant.toml").write_text(PLANT + ASKED)
    (folder / "study.toml").write_text(STUDY)
    assert (
        main(["study", str(folder / "study.toml"), "-o", str(folder / "out"), "--jobs", "1"]) == 0
    )
    return folder / "out"


@pytest.fixture
def results(done, tmp_path):
    return Path(shutil.copytree(done, tmp_path / "out"))


def faults(results):
    """What is wrong, by question."""
    return {own.question: own.fault for own in judged(Store(results), processes(1)) if own.fault}


def written(results, change):
    """Rows written anew with digests that fit; ``change`` has them by question."""
    rows = {row["question"]: row for row in Store(results).rows()}
    change(rows)
    put_rows(results, [signed(row) for row in rows.values()])


def with_claims_of(row, results, content):
    """A row that names this file of claims, and says what it does."""
    answer = read(content.decode())
    claim = "; ".join(own.said(answer.plant) for own in answer.claims)
    return row | {"proof": put_proof(results, content), "law": law_of(content), "claim": claim}


def with_file(results, question, change, **new):
    """A file of claims changed, and its row put right by it; the file is proved as it is."""

    def rewrite(rows):
        row = rows[question]
        document = json.loads(Store(results).proof(row["proof"]).read_text())
        change(document)
        content = json.dumps(document).encode()
        assert check(read(content.decode())).proved
        rows[question] = with_claims_of(row, results, content) | new

    written(results, rewrite)


def times(value, factor):
    """Numbers of a file, each so many times as large."""
    if isinstance(value, list):
        return [times(own, factor) for own in value]
    return plain(as_number(value, "") * Fraction(factor))


def claims_of(document, kind):
    return [own for own in document["claims"] if own["kind"] == kind]


def test_files_as_they_were_written_are_good(results):
    rows = {row["question"]: row for row in Store(results).rows()}
    assert {row["status"] for row in rows.values()} == {"proved"}
    assert faults(results) == {}


# --- bounds on signals ---------------------------------------------------------------------------


def _quieter(document):
    claims_of(document, "rms")[0]["intensity"] = times(
        claims_of(document, "rms")[0]["intensity"], "1/2"
    )


def _weaker_filter(document):
    (own, none) = claims_of(document, "rms")[0]["filters"]
    assert (own["name"], none) == ("Wk", {})
    own["c"] = times(own["c"], "1/2")


def _smaller_disturbance(document):
    assert claims_of(document, "rms")[0]["disturbances"] == [1, plain(Fraction(1, 2))]
    claims_of(document, "rms")[0]["disturbances"] = [1, plain(Fraction(1, 4))]


def _another_name(document):
    own = claims_of(document, "rms")[0]["outputs"][0]
    own["name"], own["C"] = "other strain", times(own["C"], "1/2")


def _one_row_less(document):
    own = claims_of(document, "rms")[0]
    (first, _), (weight, _) = own.pop("outputs"), own["filters"]
    own |= {"name": first.pop("name"), "output": first, "filters": [weight]}


def _quieter_limit(document):
    claims_of(document, "rms")[1]["intensity"] = times(
        claims_of(document, "rms")[1]["intensity"], "1/2"
    )


MINIMISED = "rms of [strain, x] from [gust, floor * 0.5] with weight [Wk, none]"
BOUNDS = {
    "half the noise": (_quieter, f"its file has no bound on {MINIMISED}"),
    "half a filter": (_weaker_filter, f"its file has no bound on {MINIMISED}"),
    "less of a disturbance": (_smaller_disturbance, f"its file has no bound on {MINIMISED}"),
    "another output": (_another_name, f"its file has no bound on {MINIMISED}"),
    "a row less": (_one_row_less, f"its file has no bound on {MINIMISED}"),
    "half the noise of a limit": (_quieter_limit, "its file has no bound 3 on rms of force"),
}


@pytest.mark.parametrize("name", BOUNDS)
def test_a_bound_on_something_else_is_found(name, results):
    change, said = BOUNDS[name]
    with_file(results, "optimise", change)
    assert faults(results) == {"optimise": said}


def test_a_level_of_another_signal_is_no_bound(results):
    """The limit's own level, which its file does prove, as that of what was minimised."""

    def change(rows):
        file = Store(results).proof(rows["optimise"]["proof"])
        first, limit = claims_of(json.loads(file.read_text()), "rms")
        assert float(as_number(first["level"], "")) == rows["optimise"]["bound"]
        rows["optimise"]["bound"] = float(as_number(limit["level"], ""))

    written(results, change)
    assert faults(results) == {"optimise": "its bound is none of its file"}


def _smaller_output(document):
    """An output that is half as large in the plant, and so in what is claimed of it."""
    own = next(own for own in document["plant"]["outputs"] if own["name"] == "strain")
    first = claims_of(document, "rms")[0]["outputs"][0]
    own["C"] = first["C"] = times(own["C"], "1/2")


def _other_parameter(document):
    """The same vertices under a parameter of other numbers."""
    own = next(own for own in document["plant"]["parameters"] if own["name"] == "k")
    own["range"] = [1, 20]


@pytest.mark.parametrize("change", [_smaller_output, _other_parameter])
def test_a_plant_of_the_same_vertices_is_another_plant(change, results):
    with_file(results, "optimise", change)
    assert faults(results) == {"optimise": "its file is about another plant"}


# --- every kind of bound, number by number -------------------------------------------------------

KINDS = {
    "rms": Rms(["strain", "x"], 9.0, 0.5, ["Wk", "none"], disturbances={"gust": 2.0, "floor": 1.0}),
    "relative rms": RelativeRms("strain", 9.0, 0.5, "Wd", disturbances={"gust": 2.0, "floor": 1.0}),
    "gain": Gain(["strain", "force"], 9.0, disturbances=["gust"]),
    "energy peak": EnergyPeak("strain", 9.0, 0.5, disturbances=["floor"]),
    "initial peak": InitialPeak("strain", 9.0, ((1.0, 2.0),), ellipsoid=((2, 1), (1, 2))),
    "impulse": InitialPeak("strain", 9.0, impulse=0.5),
    "saturation": Saturation(["u"], 9.0, ((1.0, 2.0),)),
    "saturation under disturbances": Saturation(["u"], 9.0, norm=0.5),
    "gain norm": GainNorm(9.0, (1.0, 2.0), (1.0, 3.0)),
}
OF_PROOFS = {"subject", "level", "held", "held_degree"}  # the rest is what is claimed


@cache
def designed():
    plant = loads(PLANT)
    return plant, place(plant, Disk(-4, 3.9), "quadratic").certificate


def file_of(own, level, change=lambda claim: claim):
    """A file of a claim that is not proved: what it says is all that counts here."""
    plant, certificate = designed()
    law, evidence = certificate.claim().law, Evidence([], transfer=True)
    return bounds_file(
        certificate, [change(claim_of(plant, law, "box", own, evidence, Fraction(level)))]
    )


def moved(value):
    """Yield a value with one number moved, for each of its numbers and names."""
    if isinstance(value, Fraction):
        yield value + 1
    elif isinstance(value, str):
        yield value + "'"
    elif isinstance(value, list | tuple):
        for k, own in enumerate(value):
            for other in moved(own):
                yield type(value)([*value[:k], other, *value[k + 1 :]])
    elif is_dataclass(value) and not isinstance(value, Evidence):
        for own in fields(value):
            for other in moved(getattr(value, own.name)):
                yield replace(value, **{own.name: other})


@pytest.mark.parametrize("name", KINDS)
def test_each_number_of_a_claim_counts(name):
    own, (plant, certificate) = KINDS[name], designed()
    assert len(bounds(file_of(own, 9), plant, own)) == 1
    assert fault_of(file_of(own, 9), plant, certificate.region, [own]) == ""
    said = f"its file has no bound 9 on {own.title}"
    assert fault_of(file_of(own, 10), plant, certificate.region, [own]) == said
    claim = file_of(own, 9).claims[1]
    count = 0
    for key in {own.name for own in fields(claim)} - OF_PROOFS:
        for other in moved(getattr(claim, key)):
            document = file_of(own, 9, lambda claim, key=key, x=other: replace(claim, **{key: x}))
            assert bounds(document, plant, own) == [], (key, other)
            count += 1
    assert count >= 4


def test_each_number_of_a_plant_counts():
    plant, _ = designed()
    document = file_of(KINDS["gain"], 9)
    assert is_about(document, plant)
    others = list(moved(document.plant))
    assert len(others) > 50
    assert not any(is_about(replace(document, plant=other), plant) for other in others)


# --- margins -------------------------------------------------------------------------------------


def test_a_law_that_leaves_its_first_input_alone_is_of_the_question(results, tmp_path, capsys):
    """And its margins are proved by `service`, files and all."""
    rows = {row["question"]: row for row in Store(results).rows()}
    document = read(Store(results).proof(rows["gain"]["proof"]).read_text())
    (own,) = document.claims
    assert not any(own.sizes[0])
    assert all(own.sizes[1])
    folder = place(loads(PLANT), Disk(-4, 3.9)).save(tmp_path / "law").parent
    said = ran(capsys, "service", folder, "-o", tmp_path / "margins")
    assert "error of each gain" in said
    files = sorted(own.name for own in (tmp_path / "margins").iterdir())
    assert "gain.json" in files
    for file in files:
        assert main(["check", str(tmp_path / "margins" / file)]) == 0


def _smaller_errors(document):
    (own,) = document["claims"]
    own["sizes"] = times(own["sizes"], "1/2")


def _one_gain_exact(document):
    (own,) = document["claims"]
    assert own["sizes"][1][0]
    own["sizes"][1][0] = 0


def test_errors_of_another_size_are_another_bound(results):
    with_file(results, "gain", _smaller_errors)
    assert faults(results) == {"gain": "its bound is none of its file"}
    row = next(row for row in Store(results).rows() if row["question"] == "gain")
    half = row["bound"] / 2

    def lower(rows):
        rows["gain"]["bound"] = half

    written(results, lower)
    assert faults(results) == {}


def test_a_gain_that_is_taken_as_exact_is_found(results):
    with_file(results, "gain", _one_gain_exact)
    assert faults(results) == {"gain": "its file is about other gains of the law"}


def test_an_error_of_another_parameter_is_found(results):
    def swap(rows):
        for key in ("proof", "law", "claim", "bound", "unit"):
            one, other = rows["estimate-m1"], rows["estimate-k"]
            one[key], other[key] = other[key], one[key]

    written(results, swap)
    none = "its bound is none of its file"
    assert faults(results) == {"estimate-m1": none, "estimate-k": none}


def test_a_rate_at_a_lower_decay_is_found(results):
    def change(document):
        document["claims"][0]["decay"] = 0

    with_file(results, "rate", change)
    assert faults(results) == {"rate": "its file is about a decay rate below 0.05"}


def test_a_decay_rate_outside_what_was_asked_is_found(results):
    def change(document):
        parts = document["claims"][0]["region"]["parts"]
        (own,) = (part for part in parts if part["kind"] == "disk")
        own["radius"] = times(own["radius"], 2)

    with_file(results, "decay", change)
    assert faults(results) == {"decay": "its file is not about poles within disk(-4, 3.9)"}


# --- the form of a law --------------------------------------------------------------------------

GAIN = Law([[[0, 0], [-1, -2]]])
SCHEDULED = Law(None, [[[1, 0], [0, 1]]] * 4, [[[0, 0], [-1, -2]]] * 4, 1)
CORNERS = ([[1, 0]], [[2, 0]]) * 2  # of strain = k x


def polynomial(*terms, measured=(), C=()):
    """A law of exponents in m1 and k, each with its gains."""
    powers = tuple(e for e, _ in terms)
    K = [[[as_number(x, "") for x in row] for row in K] for _, K in terms]
    degree = max(map(sum, powers))
    return Law(K, degree=degree, powers=powers, measured=measured, C=C)


IN_K = polynomial(((0, 0), [[0, 0], [-1, -2]]), ((0, 1), [[0, 0], [0, 1]]))
IN_BOTH = polynomial(((0, 0), [[0, 0], [-1, -2]]), ((1, 1), [[0, 0], [0, 1]]))
OF_SPEED = polynomial(((0, 0), [[0], [-2]]), measured=("v",), C=([[0, 1]],) * 4)
OF_STRAIN = polynomial(((0, 0), [[0], [-2]]), measured=("strain",), C=CORNERS)
ONE, ANY = Structure(degree=0), Structure()
LIMITED = Structure(("x", "v"), largest_gain=((1.0, 1.0), (1.0, 3.0)))
PATTERN = Structure(("x", "v"), (), pattern=(("0", "0"), ("a", "0")))
EQUAL = Structure(("x", "v"), (), pattern=(("0", "0"), ("a", "a")))

WITHIN = {
    "one gain of a degree": (GAIN, ANY, True),
    "one gain of a method": (GAIN, ONE, True),
    "a quotient of a method": (SCHEDULED, ANY, True),
    "a polynomial of a method": (IN_K, ANY, True),
    "fewer signals": (OF_SPEED, Structure(("x", "v")), False),
    "fewer states": (OF_SPEED, ANY, True),
    "fewer parameters": (GAIN, Structure(("x", "v"), ("k",)), False),
    "a lower degree": (IN_K, Structure(degree=2), False),
    "an output": (OF_STRAIN, Structure(("strain",)), False),
    "zeros in place of a signal": (Law([[[0, 0], [0, -2]]]), Structure(("v",), ()), False),
    "gains in their limits": (IN_K, LIMITED, False),
    "the pattern": (Law([[[0, 0], [-1, 0]]]), PATTERN, False),
    "equal gains": (Law([[[0, 0], [-1, -1]]]), EQUAL, False),
}
OUTSIDE = {
    "scheduled, one gain asked": (SCHEDULED, ONE, True, "of degree 1, not of 0"),
    "polynomial, one gain asked": (IN_K, ONE, True, "of degree 1, not of 0"),
    "a quotient, no structure": (SCHEDULED, ANY, False, "a quotient"),
    "another parameter": (IN_K, Structure(schedule=("m1",)), False, "depends on k"),
    "a parameter, none asked": (IN_K, Structure(schedule=()), False, "depends on k"),
    "a higher degree": (IN_BOTH, ANY, False, "of degree 2, not of 1"),
    "more signals": (GAIN, Structure(("v",), ()), False, "measures x"),
    "an output, states asked": (OF_STRAIN, Structure(("x", "v")), False, "measures strain"),
    "an output that varies": (OF_STRAIN, ANY, True, "measures strain"),
    "too large": (
        polynomial(((0, 0), [[0, 0], [-1, -2]]), ((0, 1), [[0, 0], [0, "11/10"]])),
        LIMITED,
        False,
        "a gain of its law exceeds 3",
    ),
    "too large within a curve": (
        polynomial(((0, 0), [[0, 0], [0, "7/2"]]), ((0, 2), [[0, 0], [0, -2]])),
        replace(LIMITED, degree=2),
        False,
        "a gain of its law exceeds 3",
    ),
    "not of the pattern": (GAIN, PATTERN, False, "not of the pattern"),
    "gains that differ": (GAIN, EQUAL, False, "not of the pattern"),
}


def of_law(law):
    plant, certificate = designed()
    return plant, replace(certificate.file(), law=law)


@pytest.mark.parametrize("name", WITHIN)
def test_a_law_within_what_was_asked_is_an_answer(name):
    law, structure, rational = WITHIN[name]
    plant, document = of_law(law)
    assert Form(plant, structure, rational).fault(document) == ""


@pytest.mark.parametrize("name", OUTSIDE)
def test_a_law_of_another_form_is_found(name):
    law, structure, rational, said = OUTSIDE[name]
    plant, document = of_law(law)
    assert said in Form(plant, structure, rational).fault(document)


ASKED_FORMS = {
    'ask = "optimise"': (SCHEDULED, ""),
    'ask = "optimise"\nmethod = "quadratic"': (SCHEDULED, "its law is of degree 1"),
    'ask = "optimise"\nmeasured = ["v"]\norder = 1': (GAIN, "its law measures x"),
    'ask = "optimise"\nschedule = []': (IN_K, "its law depends on k"),
    'ask = "cover"': (SCHEDULED, "its law is of degree 1"),
    'ask = "tightest"\ncentre = -4\nmethod = "slack"\ndegree = 2': (IN_K, "its law is of deg"),
    'ask = "tightest"\ncentre = -4': (SCHEDULED, ""),
    'ask = "design"\nregion = "disk(-4, 3)"\nmethod = "quadratic"': (IN_K, "its law is of deg"),
    'ask = "service"\nregion = "disk(-4, 3)"\ndegree = 2': (IN_BOTH, ""),
}


@pytest.mark.parametrize("asked", ASKED_FORMS)
def test_each_question_has_its_form(asked):
    law, said = ASKED_FORMS[asked]
    (question,) = read_questions([tomllib.loads(asked)])
    _, document = of_law(law)
    found = question.form(PLANT + ASKED, 2).fault(document)
    assert found.startswith(said)
    assert bool(found) == bool(said)


def test_a_scheduled_law_as_one_gain_is_found(results):
    """A file that is proved, of the region that was asked for; its form alone is another."""
    plant = loads(PLANT + ASKED, "variant")

    def change(rows):
        other = place(plant, Disk(-4, rows["disk"]["bound"]), "scheduled")
        content = other.certificate.file().dumps(None).encode()
        rows["disk"] = with_claims_of(rows["disk"], results, content)

    written(results, change)
    assert faults(results) == {"disk": "its law is of degree 1, not of 0 at most"}


# --- columns of the table ------------------------------------------------------------------------

COLUMNS = {
    "a least radius": ("disk", "least", lambda own: own * (1 + 2e-8), "its least"),
    "a least radius of none": ("decay", "least", lambda _: 0.1, "its least"),
    "a least of an optimum": ("optimise", "least", lambda _: 0.1, "its least"),
    "a worst sample": ("optimise", "worst", lambda own: own * 0.99, "its worst sample"),
    "a worst sample of none": ("disk", "worst", lambda _: 1.0, "its worst sample"),
    "a unit": ("optimise", "unit", lambda _: "N", "its unit is 'N', not "),
    "a unit of a rate": ("decay", "unit", lambda _: "", "its unit is '', not '1/s'"),
    "a unit of a margin": ("estimate-m1", "unit", lambda _: "kg", "its unit is 'kg', not "),
    "no bound on an optimum": ("optimise", "bound", lambda _: None, "has no bound"),
    "no smallest disk": ("disk", "bound", lambda _: None, "has no bound"),
    "no margin": ("rate", "bound", lambda _: None, "has no bound"),
    "another question": ("disk", "ask", lambda _: "design", "asks for design, its question for"),
    "another label": ("disk", "label", lambda _: "b", "has another label than the study"),
}


@pytest.mark.parametrize("name", COLUMNS)
def test_a_column_that_is_altered_is_found(name, results):
    question, column, altered, said = COLUMNS[name]

    def change(rows):
        own = altered(rows[question][column])
        assert own != rows[question][column]
        rows[question][column] = own
        for other in set(rows) - {question}:  # which are looked at elsewhere
            del rows[other]

    written(results, change)
    found = faults(results)
    assert set(found) == {question}
    assert found[question].startswith(said)


def test_a_bound_without_a_proof_is_found(results):
    def change(rows):
        rows["disk"] |= {"status": "not proved", "proof": "", "law": "", "claim": "", "least": None}

    written(results, change)
    assert faults(results) == {"disk": "has a bound, and names no proof"}


# --- discrete time -------------------------------------------------------------------------------

SAMPLED = """
states = ["x [m]", "v [m/s]"]
inputs = ["u [N]"]
sample_time = 0.05
constants = {c = 1}
[parameter.m1]
range = [2, 3]
through = "1/m1"
[matrices]
A = [[1, 0.05], [-0.05, "1 - c/20"]]
B = [[0], ["0.05/m1"]]
"""
IN_TIME = """
base = "plant.toml"
[variants]
grid = {c = [1]}
[[question]]
ask = "design"
region = "half_plane(0.5)"
[[question]]
ask = "service"
region = "half_plane(0.5)"
[[question]]
ask = "tightest"
name = "decay"
of = "half_plane"
[[question]]
ask = "tightest"
name = "damping"
of = "sector"
"""


def test_regions_of_continuous_time_are_kept_by_their_images(tmp_path):
    """A decay rate a by a disk of radius exp(-a T), a damping ratio by its polygon."""
    (tmp_path / "plant.toml").write_text(SAMPLED)
    (tmp_path / "study.toml").write_text(IN_TIME)
    out = tmp_path / "out"
    assert main(["study", str(tmp_path / "study.toml"), "-o", str(out), "--jobs", "1"]) == 0
    assert faults(out) == {}
    rows = {row["question"]: row for row in Store(out).rows()}
    document = json.loads(Store(out).proof(rows["decay"]["proof"]).read_text())
    radius = float(as_number(document["claims"][0]["region"]["radius"], ""))
    assert rows["decay"]["bound"] == pytest.approx(-math.log(radius) / 0.05, rel=1e-6)
    assert rows["damping"]["bound"] > 0.7
    assert rows["decay"]["unit"] == "1/s"

    def larger(rows):
        rows["decay"]["bound"] *= 1.01
        rows["damping"]["bound"] *= 1.001

    written(out, larger)
    none = "its bound is none of its file"
    assert faults(out) == {"decay": none, "damping": none}

    def impossible(rows):
        rows["decay"]["bound"] = math.nan
        rows["damping"]["bound"] = 7.0

    written(out, impossible)
    assert faults(out) == {"decay": none, "damping": none}
