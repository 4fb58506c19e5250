"""A folder of C99 from a design: what is in it, what is refused, what `check` says of it."""

import hashlib
import io
import json
import math
import re
import shutil
from contextlib import redirect_stdout, suppress
from fractions import Fraction
from functools import cache

import numpy as np
import pytest

from polefence import (
    DesignFileError,
    Disk,
    HalfPlane,
    InputError,
    NotProvedError,
    OutputError,
    UncertainPlant,
    load,
    optimise,
    place,
)
from polefence.certify.margins.claims import firmer
from polefence.cli.main import main
from polefence.examples import family, spec_path
from polefence.export import check_guarantee, export_c99
from polefence.export.guarantee import guarantee, roundings
from polefence.export.program import code_law, number
from polefence.export.program import program as program_of
from polefence.requirements.text import load_specifications
from polefence.response.discrete import Sampling
from support.commands import ran, refused
from support.files import rewritten
from support.once import proved_once  # noqa: F401

FILES = {"law.c", "law.h", "law_test.c", "Makefile", "README.md", "guarantee.json"}
TIMED = FILES | {"sampled.json"}


@cache
def design(radius=31, method="scheduled", plant="quarter-car-physical"):
    return place(family(plant), Disk(-40, radius), method)


@cache
def exported(bits=32):
    """The export of the car's design, made once."""
    return export_c99(design(), bits)


@pytest.fixture
def saved(tmp_path):
    design().save(tmp_path / "car")
    return tmp_path / "car"


def run(*arguments):
    return main(["export", *map(str, arguments)])


def test_the_folder_is_whole_and_proved(saved, tmp_path, capsys):
    out = tmp_path / "out"
    assert run(saved, "--float", 32, "-o", out) == 0
    text = capsys.readouterr().out
    assert "Proved in exact arithmetic" in text
    assert {path.name for path in out.iterdir()} == FILES
    assert "float32 code" in ran(capsys, "check", out)
    assert run(saved, "--float", 32, "-o", out) == 0  # over an export of its own
    (out / "build").mkdir()
    assert run(saved, "--float", 64, "-o", out) == 0
    assert json.loads((out / "guarantee.json").read_text())["claims"][0]["code"]["bits"] == 64


def test_the_same_design_gives_the_same_bytes():
    assert export_c99(design(), 32).files == exported().files


def test_the_constants_of_the_code_are_those_that_are_proved():
    """Read back from the C text, against the file about them."""
    files = exported().files
    code = json.loads(files["guarantee.json"])["claims"][0]["code"]
    source = files["law.c"].decode()

    def table(name):
        body = re.search(rf"static const law_real {name}\[.*?\] = \{{(.*?)\}};", source, re.DOTALL)[
            1
        ]
        return np.array([float(v) for v in re.findall(r"-?[\d.]+(?:e[+-]?\d+)?(?=F)", body)])

    lower = np.tril_indices(5)
    single = np.float32
    assert np.array_equal(table("T").astype(single), np.array(code["T"])[lower].astype(single))
    W = np.array(code["W"])[:, lower[0], lower[1]].T
    assert np.array_equal(table("W").astype(single), W.ravel().astype(single))
    Z = np.array(code["Z"])[:, 0].T
    assert np.array_equal(table("Z").astype(single), Z.ravel().astype(single))
    assert np.array_equal(W.astype(single).astype(float), W)  # exactly what float32 holds
    for share in code["shares"]:
        for value in share.values():
            assert np.float64(np.float32(value)) == value
            assert f"{value:.9g}".lstrip("-") in source


@pytest.mark.parametrize("change", ["law.c", "law.h"])
def test_changed_sources_are_not_what_is_proved(change, tmp_path, capsys):
    exported().save(tmp_path)
    path = tmp_path / change
    path.write_text(path.read_text().replace("0.0F", "0.5F").replace("OK 0U", "OK 1U"))
    answer = check_guarantee(tmp_path)
    assert not answer.proved
    assert change in answer.reason
    assert main(["check", str(tmp_path)]) == 1
    path.unlink()
    assert "missing" in check_guarantee(tmp_path / "guarantee.json").reason


def test_foreign_files_are_left_alone(saved, tmp_path, capsys):
    out = tmp_path / "out"
    out.mkdir()
    (out / "main.c").write_text("int main(void) { return 0; }\n")
    error = refused(capsys, "export", saved, "-o", out)
    assert "main.c" in error
    assert [path.name for path in out.iterdir()] == ["main.c"]
    (out / "main.c").rename(out / "law.c")  # of the same name, but not ours
    assert "law.c" in refused(capsys, "export", saved, "-o", out)
    assert (out / "law.c").read_text().startswith("int main")
    (tmp_path / "file").write_text("")
    assert run(saved, "-o", tmp_path / "file") == 2


def test_an_export_of_another_name_is_foreign(tmp_path):
    export_c99(design(), 32, name="front").save(tmp_path)
    with pytest.raises(OutputError, match=r"front_test\.c|front\.[ch]"):
        exported().save(tmp_path)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--name", "static"], "name"),
        (["--name", "9lives"], "name"),
        (["--name", "a b"], "name"),
        (["--limit", "-3"], "limits"),
        (["--limit", "nan"], "limits"),
        (["--limit", "1", "--limit", "2"], "limits"),
    ],
)
def test_bad_options_are_one_line(arguments, words, saved, tmp_path, capsys):
    assert words in refused(capsys, "export", saved, "-o", tmp_path / "out", *arguments)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("arguments", [["--float", "16"], ["--lang", "ada"], ["--given", "p"]])
def test_unknown_choices_are_usage(arguments, saved, tmp_path, capsys):
    with pytest.raises(SystemExit) as stop:
        run(saved, "-o", tmp_path / "out", *arguments)
    assert stop.value.code == 2


def test_a_design_that_cannot_be_read(tmp_path, capsys):
    (tmp_path / "design.json").write_text("{}")
    assert run(tmp_path, "-o", tmp_path / "out") == 2
    assert not (tmp_path / "out").exists()


def test_what_is_given(tmp_path):
    by_alpha = export_c99(design(), 32, given="alpha")
    assert "alpha[LAW_VERTICES]" in by_alpha.files["law.h"].decode()
    A, B = ([v.A for v in design().plant.vertices], [v.B for v in design().plant.vertices])
    printed = place(UncertainPlant.from_vertices(A, B), Disk(-40, 31), "scheduled")
    assert "alpha[LAW_VERTICES]" in export_c99(printed, 32).files["law.h"].decode()
    with pytest.raises(InputError, match="given by its vertices"):
        export_c99(printed, 32, given="parameters")
    with pytest.raises(InputError, match="given = 'weights'"):
        export_c99(design(), 32, given="weights")
    fixed = export_c99(design(36, "quadratic"), 32)
    assert "law_update(const law_real x[" in re.sub(r"\s+", " ", fixed.files["law.h"].decode())


def test_too_small_a_margin_is_refused_for_float32_and_accepted_for_float64(tmp_path, capsys):
    """The claim is false when it should be."""
    design(29.08).save(tmp_path / "tight")
    out = tmp_path / "out"
    assert "--float 64" in refused(
        capsys, "export", tmp_path / "tight", "--float", 32, "-o", out, status=1
    )
    assert not out.exists()
    assert run(tmp_path / "tight", "--float", 64, "-o", out) == 0
    assert main(["check", str(out)]) == 0
    shutil.rmtree(out)
    assert run(tmp_path / "tight", "--float", 32, "-o", out, "--allow-unproved") == 1
    assert "NOT PROVED" in (out / "law.h").read_text()
    assert "NOT PROVED" in (out / "README.md").read_text()
    assert not (out / "guarantee.json").exists()


def test_an_unproved_export_over_a_proved_one_leaves_no_stale_proof(tmp_path):
    exported().save(tmp_path)
    export_c99(design(29.08), 32, allow_unproved=True).save(tmp_path)
    assert not (tmp_path / "guarantee.json").exists()


def test_limits_are_in_the_code(tmp_path):
    found = export_c99(design(), 32, limits=2000)
    assert "LIMIT[INPUTS] = { 2000.0F }" in found.files["law.c"].decode()
    assert "LAW_LIMITED" in found.files["law.h"].decode()
    assert any("limits" in line for line in found.texts.statement)
    with pytest.raises(InputError, match="2 numbers for 1 input"):
        export_c99(design(), 32, limits=(1, 2))


def test_an_unproved_design_is_not_exported():
    from polefence.certify.design import Design

    good = design()
    certificate = good.certificate
    from dataclasses import replace

    bad = Design(replace(certificate, region=Disk(-40, 20)), proved=False)
    with pytest.raises(NotProvedError, match="not proved"):
        export_c99(bad, 64)


@pytest.mark.parametrize(("low", "high"), [("1e-50", "1"), ("1", "1e50"), ("1e-20", "1e-3")])
def test_an_interval_out_of_reach_of_the_numbers_is_refused(low, high):
    from polefence import Parameter, ScheduledGain
    from polefence.export.program import number, program

    parameter = Parameter("c", low, high, through="1/c")
    law = ScheduledGain(np.ones((2, 1, 1)), np.ones((2, 1, 1)), (parameter,))
    with pytest.raises(InputError, match="c: "):
        program(law, (parameter,), number(32))


@pytest.fixture(scope="module")
def commanded(tmp_path_factory):
    """A folder with a sample time, what the command said of it, and how it ended."""
    folder, said = tmp_path_factory.mktemp("timed"), io.StringIO()
    design().save(folder / "car")
    with redirect_stdout(said):
        status = run(folder / "car", "--float", 32, "--sample-time", 0.002, "-o", folder / "out")
    return folder / "out", said.getvalue(), status


@pytest.fixture
def timed(commanded, tmp_path):
    """A copy of that folder."""
    return shutil.copytree(commanded[0], tmp_path / "out")


def test_a_sample_time_is_proved_with_the_rounding(commanded, timed, capsys):
    _, said, status = commanded
    assert status == 0
    assert "proved to decay" in said
    said = ran(capsys, "check", timed)
    assert "poles in disk(0, 0.98" in said
    assert "samples every 2 ms of x' = A x + B u" in said
    assert "u 1 sample late" in said


def rounding(whole):
    return next(table for table in whole["claims"] if table["kind"] == "rounding")


def samples(whole):
    return next(table for table in whole["claims"] if table["kind"] == "samples")


def scaled(table, *keys, by=1.01):
    """Multiply one number of a table."""
    for key in keys[:-1]:
        table = table[key]
    assert table[keys[-1]] not in (0, None)
    table[keys[-1]] = float(Fraction(table[keys[-1]])) * by


FAULTS = {
    "the law": lambda whole: scaled(whole["law"], "Z", 0, 0, 0),
    "the code": lambda whole: scaled(rounding(whole), "code", "Z", 0, 0, 0, by=1.5),
    "a gain of what is late": lambda whole: rounding(whole)["code"]["Z"][0][0].__setitem__(5, 1.0),
    "the number of bits": lambda whole: rounding(whole)["code"].update(bits=64),
    "the sample time": lambda whole: whole["plant"].update(sample_time=0.004),
    "the delay": lambda whole: samples(whole).update(delay=0),
    "the plant that is sampled": lambda whole: scaled(samples(whole), "vertices", 0, "A", 3, 0),
    "the samples": lambda whole: scaled(whole["plant"]["vertices"][0], "A", 0, 0),
    "the remainder": lambda whole: whole["plant"].pop("remainder"),
    "a range": lambda whole: whole["plant"]["parameters"][0].update(range=[240, 340]),
    "less rounding": lambda whole: scaled(rounding(whole), "gain", "error", by=0.01),
    "a smaller disk": lambda whole: scaled(rounding(whole), "gain", "region", "radius", by=0.99),
    "no rounding": lambda whole: whole["claims"].remove(rounding(whole)),
    "no samples": lambda whole: whole["claims"].remove(samples(whole)),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_changed_file_of_the_sampled_loop_is_refused(timed, fault):
    path = timed / "sampled.json"
    with rewritten(path) as whole:
        assert check_guarantee(timed).proved
        FAULTS[fault](whole)
    with suppress(DesignFileError):
        assert not check_guarantee(timed).proved


def test_the_file_of_another_loop_is_refused(timed):
    """It is proved, but of another law than the code's, or of another plant."""
    path = timed / "sampled.json"
    for other in (place(family("quarter-car-physical"), Disk(-40, 35), "quadratic"),):
        path.write_bytes(export_c99(other, 32, sampling=Sampling(0.002)).files["sampled.json"])
        with pytest.raises(DesignFileError, match="its law is not the code's"):
            check_guarantee(timed)
    path.unlink()
    with pytest.raises(DesignFileError, match=r"sampled\.json"):
        check_guarantee(timed)


WORDS = {
    "sample time": ("law.h", "LAW_SAMPLE_TIME 0.002F", "LAW_SAMPLE_TIME 0.05F"),
    "delay": ("law.h", "LAW_DELAY 1U", "LAW_DELAY 0U"),
    "how often": ("law.h", "Run every 2 ms", "Run every 50 ms"),
    "region": ("law.h", "disk(-40, 31)", "disk(-40, 21)"),
    "rounding": ("law.h", "is at most", "is below"),
    "what was looked at": ("law.h", "Sampled, not proved", "Proved"),
    "page": ("README.md", "disk(-40, 31)", "disk(-40, 21)"),
}


@pytest.mark.parametrize("word", WORDS)
def test_every_word_is_that_of_the_proof(timed, word):
    name, old, new = WORDS[word]
    text = (timed / name).read_text()
    assert old in text
    (timed / name).write_text(text.replace(old, new))
    answer = check_guarantee(timed)
    assert not answer.proved
    assert name in answer.reason


def test_the_text_cannot_say_another_time_than_the_proof(timed):
    """What the head says of time, region and rounding is written from the claims alone."""
    path = timed / "guarantee.json"
    whole = json.loads(path.read_text())
    assert whole["export"]["text"].keys() == {"name", "limits", "sampled"}
    numbers = dict.fromkeys(("points", "decay", "region", "stable"), 0)
    for table in (
        whole["export"]["text"] | {"sample_time": 0.05},
        whole["export"]["text"] | {"delay": 0},
        whole["export"]["text"] | {"statement": []},
        whole["export"]["text"] | {"sampled": None},
        whole["export"]["text"]
        | {"sampled": whole["export"]["text"]["sampled"] | {"proved": True}},
        whole["export"]["text"] | {"sampled": numbers | {"inside": 1, "observer": None}},
        whole["export"]["text"] | {"sampled": numbers | {"inside": True, "observer": [1, 2.0]}},
    ):
        path.write_text(json.dumps(whole | {"export": whole["export"] | {"text": table}}))
        with pytest.raises(DesignFileError, match="text"):
            check_guarantee(timed)
    # what was sampled may be another's word, and its line says that it is no proof
    whole["export"]["text"]["sampled"]["decay"] = 99.0
    path.write_text(json.dumps(whole))
    assert "law.h" in check_guarantee(timed).reason
    head = re.sub(r"[\s*]+", " ", (timed / "law.h").read_text())
    assert re.search(r"Sampled, not proved: [^.]*\b10040\b", head)


def test_a_wider_region_kept_is_what_the_head_says(tmp_path):
    """The claim about the code may be of another region than the design's own."""
    exported().save(tmp_path)
    path = tmp_path / "guarantee.json"
    with rewritten(path) as whole:
        whole["claims"][0]["gain"]["region"] = Disk(-40, 39).document()
    answer = check_guarantee(tmp_path)
    assert not answer.proved  # law.h says disk(-40, 31)
    assert "law.h" in answer.reason


def test_too_long_a_sample_time_is_refused_and_leaves_nothing_to_check(saved, tmp_path, capsys):
    out = tmp_path / "out"
    assert "found stable up to 7.1" in refused(
        capsys, "export", saved, "--sample-time", 0.01, "-o", out, status=1
    )
    assert not out.exists()
    assert run(saved, "--sample-time", 0.01, "-o", out, "--allow-unproved") == 1
    assert "NOT PROVED to be stable" in (out / "law.h").read_text()
    assert not (out / "guarantee.json").exists()
    capsys.readouterr()
    assert "no file of claims" in refused(capsys, "check", out)
    for value in ("0", "-1", "nan", "inf"):
        refused(capsys, "export", saved, f"--sample-time={value}", "-o", tmp_path / "other")
    assert not (tmp_path / "other").exists()


def test_an_observer_is_put_beside_the_law(saved, tmp_path, capsys):
    from polefence import observe

    plant = design().plant
    measured = ["suspension deflection", "sprung-mass velocity", plant.states[4]]
    observer = observe(plant, measured, Disk(-80, 30))
    observer.save(tmp_path / "observer")
    out = tmp_path / "out"
    arguments = [saved, "--float", 32, "--observer", tmp_path / "observer", "-o", out]
    assert "--sample-time" in refused(capsys, "export", *arguments)
    assert run(*arguments, "--sample-time", 0.002) == 0
    assert {path.name for path in out.iterdir()} == TIMED | {"law_observer.c", "law_observer.h"}
    assert "Observer: proved" in (out / "README.md").read_text()
    capsys.readouterr()
    assert "poles in disk(-80, 30), of A - L C with -L(alpha)'" in ran(capsys, "check", out)
    observer_is_proved(out)
    (out / "law_observer.c").write_text("")
    assert main(["check", str(out)]) == 1
    assert run(tmp_path / "observer", "-o", tmp_path / "dual") == 2  # no law
    assert "--observer" in capsys.readouterr().err
    assert run(*arguments, "--sample-time", 0.002, "--lang", "fmu") == 2
    # an export without it leaves none behind, but does not take what is not ours
    assert run(saved, "-o", out) == 2
    (out / "law_observer.c").unlink()
    assert run(saved, "-o", out) == 0
    assert {path.name for path in out.iterdir()} == FILES
    assert run(saved, "--observer", saved, "--sample-time", 0.002, "-o", out) == 2


def observer_is_proved(out):
    """The sentences about an observer are of one that is in the file, and proved afresh."""
    path, head = out / "guarantee.json", out / "law_observer.h"
    text, original = path.read_text(), head.read_text()
    told = original.replace("disk(-80, 30)", "disk(-80, 20)")
    assert told != original

    def answer(change, head_text=original):
        whole = json.loads(text)
        change(whole)
        path.write_text(json.dumps(whole))
        head.write_text(head_text)
        return check_guarantee(out)

    def digest(whole):
        whole["export"]["files"]["law_observer.h"] = hashlib.sha256(told.encode()).hexdigest()

    assert answer(lambda whole: None).proved
    assert "law_observer.h" in answer(digest, told).reason
    narrower = answer(lambda whole: whole["claims"][-1]["region"].update(radius=20.0))
    assert narrower.answer == "refuted"
    assert narrower.reason.startswith("claim 2, observer: at alpha = ")
    for change in (
        lambda whole: whole["claims"].pop(),
        lambda whole: whole["claims"][-1].update(law=whole["law"]),
        lambda whole: whole["export"].update(by_parameters=1),
        lambda whole: whole["export"].pop("by_parameters"),
        lambda whole: whole["export"]["files"].pop("law_observer.c"),
        lambda whole: whole.pop("export"),
    ):
        with pytest.raises(DesignFileError):
            answer(change)
    path.write_text(text)
    head.write_text(original)


def test_a_guarantee_of_other_code_is_no_guarantee(tmp_path):
    """The law's sources are written again from the constants that the proof is about."""
    exported().save(tmp_path)
    path, source = tmp_path / "guarantee.json", tmp_path / "law.c"
    whole, text = json.loads(path.read_text()), source.read_text()

    def answer(gain=None, code=None, **changes):
        (claim,) = whole["claims"]
        claim = claim | {"gain": claim["gain"] | (gain or {}), "code": claim["code"] | (code or {})}
        export = whole["export"] | changes
        path.write_text(json.dumps(whole | {"claims": [claim], "export": export}))
        return check_guarantee(tmp_path)

    assert answer().proved
    source.write_text(text.replace("58.2491798F", "99.0F"))
    assert "58.2491798F" in text
    assert "law.c" in answer(files={}).reason
    with pytest.raises(DesignFileError, match="not a file of this export"):
        answer(files={"law.c": hashlib.sha256(source.read_bytes()).hexdigest()})
    source.write_text(text)
    assert not answer(code={"bits": 64}).proved
    assert not answer(text=whole["export"]["text"] | {"limits": [10.0]}).proved
    told = ({"name": 3}, {"name": "../law"}, {"sample_time": 0.001}, {"statement": ["Proved."]})
    for wrong in ({}, [], *(whole["export"]["text"] | each for each in told)):
        with pytest.raises(DesignFileError):
            answer(text=wrong)
    for name in ("../law.c", "x" * 5000):
        with pytest.raises(DesignFileError):
            answer(files={name: "0"})
    for key, value in (("error", math.inf), ("error", "1/" + "9" * 290), ("columns", [1.0] * 5)):
        with suppress(DesignFileError):
            assert not answer(gain={key: value}).proved
    with pytest.raises(DesignFileError):
        answer(code={"bits": []})


def test_a_discrete_time_plant_runs_at_its_own_time(tmp_path):
    A = [[[0.9, 0.1], [0.0, 1.1]], [[0.8, 0.1], [0.0, 1.1]]]
    plant = UncertainPlant.from_vertices(A, [[[0.0], [0.1]]] * 2, sample_time="0.005")
    made = place(plant, Disk(0.5, 0.45), "scheduled")
    found = export_c99(made, 64)
    head = found.files["law.h"].decode()
    assert "Run every 5 ms, the plant's own, u without delay" in head
    assert "without sampling" not in head
    assert "#define LAW_SAMPLE_TIME 0.005" in head
    assert "#define LAW_DELAY 0U" in head
    with pytest.raises(InputError, match="discrete"):
        export_c99(made, 64, sampling=Sampling(0.005))
    found.save(tmp_path)
    assert check_guarantee(tmp_path).proved


@pytest.mark.parametrize(
    "arguments",
    [
        ["--delay", 0],
        ["--lang", "mat", "--sample-time", 0.01],
        ["--lang", "mat", "--limit", 3],
        ["--lang", "mat", "--float", 32],
        ["--sample-time", 1e-30],
        ["--limit", 1e60],
    ],
)
def test_options_without_a_meaning_are_refused(arguments, saved, tmp_path, capsys):
    refused(capsys, "export", saved, *arguments, "-o", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_folder_without_a_design_says_what_to_name(tmp_path, capsys):
    assert "polefence design -o" in refused(capsys, "export", tmp_path, "-o", tmp_path / "out")


def test_a_guarantee_cut_short_is_named(tmp_path, capsys):
    exported().save(tmp_path)
    path = tmp_path / "guarantee.json"
    path.write_text(path.read_text()[:500])
    assert "guarantee.json" in refused(capsys, "check", tmp_path)


@pytest.mark.parametrize("bits", [32, 64])
def test_a_law_of_one_vertex_is_one_gain(bits, tmp_path):
    plant = UncertainPlant.from_vertices([[[0.0, 1.0], [-2.0, -0.3]]], [[[0.0], [1.0]]])
    made = place(plant, Disk(-5, 4), "scheduled")
    found = export_c99(made, bits)
    assert "static const law_real K[" in found.files["law.c"].decode()
    found.save(tmp_path)
    assert check_guarantee(tmp_path).proved
    K = np.array(json.loads((tmp_path / "guarantee.json").read_text())["claims"][0]["code"]["K"])
    assert pytest.approx(made.law.gain([1.0]), rel=1e-6) == K
    path = tmp_path / "guarantee.json"
    with rewritten(path) as whole:
        whole["claims"][0]["code"]["K"][0][0] *= 2
    assert not check_guarantee(tmp_path).proved


def test_rounding_is_borne_by_the_matrices_of_a_smaller_region():
    """Those of a law for signals leave next to no room in the region of all stable loops."""
    path = spec_path("quarter-car-ride")
    plant, (least, limits) = load(path), load_specifications(path)
    car = optimise(plant, least, limits, HalfPlane(0), method="scheduled").design
    program = program_of(code_law(car.law), plant.parameters, number(32))
    (rounding,) = roundings(car, program)
    assert rounding.needed > 100 * rounding.guarantee(car).tolerated
    done = guarantee(car, program)
    assert done.check().answer == "proved"
    assert done.design.region == car.region
    assert done.tolerated > 100 * done.rounding
    inner = [other.certificate for other in firmer(car, car.region)]
    assert inner
    assert all(one.prove().proved for one in inner)
    assert all(np.array_equal(one.law.form, car.law.form) for one in inner)
