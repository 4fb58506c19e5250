"""Studies from the command line: rows, proofs, and what befalls processes and files."""

import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import pytest

from polefence import Disk, check, in_service, place, tightest
from polefence.cli.main import main
from polefence.examples import spec_text
from polefence.fleet import Store, judged, load_study, processes, run
from polefence.fleet.store import digest_of
from polefence.plant.spec import loads
from support.commands import ran, refused
from support.files import rewritten
from support.studies import keys, put_proof, put_rows, signed

pytest.importorskip("pyarrow")

STUDY = """
name = "hatchbacks"
base = "car.toml"

[variants]
random = {count = COUNT, seed = 1, of = {m2 = [25, 32], "m1.high" = [300, 380]}}

[[question]]
ask = "tightest"
centre = -40

[[question]]
name = "wide"
ask = "design"
region = "disk(-40, 39)"
method = "quadratic"
"""


MASS = """
states = ["x [m]", "v [m/s]"]
inputs = ["u [N]"]
constants = {c = 1}
[parameter.m1]
range = [231, 346]
through = "1/m1"
[parameter.k]
range = [0, 200]
[matrices]
A = [[0, 1], ["-k/100", "-c/m1"]]
B = [[0], ["1/m1"]]
"""
FEW = 4  # variants of the study that most tests share


def write(folder, count=FEW, text=STUDY):
    (folder / "car.toml").write_text(spec_text("quarter-car-physical"))
    path = folder / "study.toml"
    path.write_text(text.replace("COUNT", str(count)))
    return path


def command(*words):
    return [sys.executable, "-m", "polefence", "study", *map(str, words)]


def started(*words, **options):
    kept = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen(command(*words), **kept | options)


def every(count):
    return Counter((k, name) for k in range(count) for name in ("tightest", "wide"))


def temporary(folder):
    return [own for own in folder.rglob("*") if ".polefence-" in own.name]


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """A study and its results."""
    folder = tmp_path_factory.mktemp("done")
    path = write(folder)
    assert main(["study", str(path), "-o", str(folder / "out"), "--jobs", "1"]) == 0
    return path, folder / "out"


@pytest.fixture
def results(done, tmp_path):
    """A copy of these results."""
    return Path(shutil.copytree(done[1], tmp_path / "out"))


def test_rows_are_what_the_questions_answer_one_by_one(done):
    study, rows = load_study(done[0]), list(Store(done[1]).rows())
    assert keys(done[1]) == every(FEW)
    for row in rows:
        assert row["status"] == "proved"
        assert digest_of(row) == row["digest"]
        plant = loads(study.spec(row["variant"]))
        file = Store(done[1]).proof(row["proof"])
        answer = check(file)
        assert answer.proved
        assert row["claim"] == "; ".join(answer.claims)
        high = next(own.high for own in plant.parameters if own.name == "m1")
        assert row["m1.high"] == float(high)
        if row["question"] == "tightest":
            alone = tightest(plant, -40)
            assert row["bound"] == alone.region.radius
            assert row["least"] == alone.lower
            assert row["least"] < row["bound"]
        else:
            assert row["bound"] is None


def test_other_tools_read_rows_as_one_table(done):
    from pyarrow import dataset

    table = dataset.dataset(done[1] / "rows").to_table()
    assert table.num_rows == 2 * FEW
    assert {"variant", "question", "bound", "proof", "m2", "m1.high"} <= set(table.column_names)


def test_results_say_what_they_are(done, capsys):
    path, out = done
    said = ran(capsys, "study", out)
    assert f"{2 * FEW} of {2 * FEW} rows of hatchbacks" in said
    rows = [row for row in Store(out).rows() if row["question"] == "tightest"]
    shown = re.search(rf"tightest: {FEW} proved; (\S+) to (\S+) 1/s", said)
    low, high = map(float, shown.groups())
    bounds = [row["bound"] for row in rows]
    assert low >= min(bounds)  # rounded to the weaker side
    assert high >= max(bounds)
    assert high == pytest.approx(max(bounds), rel=1e-5)
    lines = ran(capsys, "study", out, "--best", "tightest").splitlines()
    best = min(rows, key=lambda row: row["bound"])
    assert int(lines[1].split()[0]) == best["variant"]
    said = ran(capsys, "study", path, "--estimate")
    assert re.search(rf"{2 * FEW} rows: about \S+ s of one processor, 0\.\d+ MB", said)
    assert main(["study", str(path), "--variant", "2"]) == 0
    assert loads(capsys.readouterr().out).digest == loads(load_study(path).spec(2)).digest


def test_a_variant_that_fails_is_a_row_and_the_others_go_on(tmp_path, capsys):
    text = """base = "car.toml"
[variants]
grid = {"m2" = [28, -3, 30]}
[[question]]
ask = "design"
region = "disk(-40, 27.5)"
method = "quadratic"
"""
    out = tmp_path / "out"
    words = ["study", str(write(tmp_path, text=text)), "-o", str(out), "--jobs", "1"]
    said = ran(capsys, *words, status=1)
    assert "design: 1 error, 2 not proved" in said
    assert "variant 0 and 1 more: not proved: " in said
    rows = {row["variant"]: row for row in Store(out).rows()}
    assert rows[1]["status"] == "error"
    assert "m2" in rows[1]["reason"] or "unsprung" in rows[1]["reason"]
    assert not any(row["proof"] for row in rows.values())
    assert main(["study", str(out), "--check", "--jobs", "1"]) == 0


def test_the_page_has_every_question_and_every_kind_of_failure(tmp_path, capsys):
    text = """name = "<b>fleet</b>"
base = "car.toml"
[variants]
grid = {m2 = [28, -3, 30], kt = [150000, 160000]}
[[question]]
name = "<script>"
ask = "tightest"
centre = -40
[[question]]
ask = "design"
region = "disk(-40, 27)"
method = "quadratic"
"""
    out, page = tmp_path / "out", tmp_path / "page.html"
    main(["study", str(write(tmp_path, text=text)), "-o", str(out), "--jobs", "1"])
    assert f"saved: {page}" in ran(capsys, "study", out, "--html", page, status=1)
    html = page.read_text()
    assert "<h1>&lt;b&gt;fleet&lt;/b&gt;: 6 variants</h1>" in html
    assert "4 of 12 answers proved" in html
    assert "<script" not in html
    assert html.count("data:image/svg+xml;base64,") == 1  # designs have no bounds
    assert "Red crosses" in html
    assert "<td>2 error, 4 proved</td>" in html
    assert "<td>2 error, 4 not proved</td>" in html
    bounds = [row["bound"] for row in Store(out).rows() if row["bound"]]
    shown = re.search(r"4 proved</td><td>([\d.]+)</td><td>[\d.]+</td><td>([\d.]+)", html)
    low, high = map(float, shown.groups())
    assert low >= min(bounds)
    assert high >= max(bounds)
    assert not re.search(r"(src|href)=\"(?!data:)", html)
    message = refused(capsys, "study", str(out), "--html", str(tmp_path))
    assert "is a folder; name a file" in message


def test_margins_of_variants_are_proved_and_rounded_down(tmp_path, capsys):
    text = """base = "mass.toml"
[variants]
grid = {"m1.high" = [346, 380]}
"""
    (tmp_path / "mass.toml").write_text(MASS)
    margins = ["gain", "estimate-m1", "rate", "estimate"]
    for name in margins:
        text += f'[[question]]\nname = "{name}"\nask = "service"\nmargin = "{name}"\n'
        text += 'region = "disk(-40, 8)"\n'
    path, out = write(tmp_path, text=text), tmp_path / "out"
    said, study = ran(capsys, "study", path, "-o", out, "--jobs", "1"), load_study(path)
    rows = list(Store(out).rows())
    alone = in_service(place(loads(study.spec(1)), Disk(-40, 8)))
    for name in margins:
        low, high = map(float, re.search(rf"{name}: 2 proved; (\S+) to (\S+)", said).groups())
        own = {row["variant"]: row["bound"] for row in rows if row["question"] == name}
        assert low <= min(own.values())
        assert high <= max(own.values())
        assert own[1] == alone[name].value
    assert main(["study", str(out), "--best", "gain"]) == 0
    best = max((row for row in rows if row["question"] == "gain"), key=lambda row: row["bound"])
    assert int(capsys.readouterr().out.splitlines()[1].split()[0]) == best["variant"]
    assert main(["study", str(out), "--check", "--jobs", "1"]) == 0

    def larger(rows):
        return [signed(row, bound=row["bound"] * 1.001) for row in rows]

    changed(out, larger)
    faults = [own.fault for own in judged(Store(out), processes(1))]
    assert faults == ["its bound is none of its file"] * 8


def test_limits_and_structures_come_from_the_base_or_the_question(tmp_path, capsys):
    (tmp_path / "ride.toml").write_text(spec_text("quarter-car-ride"))
    text = """base = "ride.toml"
[variants]
grid = {m2 = [28]}
[[question]]
ask = "optimise"
method = "quadratic"
[[question]]
name = "softer"
ask = "optimise"
method = "quadratic"
limits = ["rms of actuator force <= 300"]
[[question]]
name = "no such limit"
ask = "optimise"
limits = ["rms of actuator force"]
"""
    path, out = write(tmp_path, text=text), tmp_path / "out"
    assert main(["study", str(path), "-o", str(out), "--jobs", "1"]) == 1
    rows = {row["question"]: row for row in Store(out).rows()}
    assert rows["optimise"]["status"] == rows["softer"]["status"] == "proved"
    for row in (rows["optimise"], rows["softer"]):
        assert row["worst"] <= row["bound"]
        assert row["unit"] == "m/s2"
    assert rows["optimise"]["bound"] <= rows["softer"]["bound"] * (1 + 1e-6)
    assert "rms of 'actuator force' = u1 <= 300" in rows["softer"]["claim"]
    assert "rms of 'actuator force' = u1 <= 660" in rows["optimise"]["claim"]
    assert "has no limit; write for example" in rows["no such limit"]["reason"]
    assert main(["study", str(out), "--check", "--jobs", "1"]) == 0

    def looser(rows):
        own, other = of(rows, "softer"), of(rows, "optimise")
        keys = ("proof", "law", "claim", "bound", "worst")
        return [signed(own, **{key: other[key] for key in keys}), other, of(rows, "no such limit")]

    changed(out, looser)
    (fault,) = [own.fault for own in judged(Store(out), processes(1)) if own.fault]
    assert fault == "its file has no bound 300 on rms of actuator force"


def test_resuming_works_out_what_is_missing_alone(done, tmp_path, capsys):
    out = Path(shutil.copytree(done[1], tmp_path / "out"))
    gone = sorted((out / "rows").iterdir())[0]
    lost = keys(out)
    gone.unlink()
    missing = lost - keys(out)
    capsys.readouterr()
    study = load_study(done[0])
    fresh = [row for rows in run(study, Store(out), processes(1), True) for row in rows]
    assert Counter((row["variant"], row["question"]) for row in fresh) == missing
    assert keys(out) == every(FEW)
    message = refused(capsys, "study", str(done[0]), "-o", str(out))
    assert "has results of this study; go on by --resume" in message


def test_results_of_another_study_are_left_alone(done, tmp_path, capsys):
    path = write(tmp_path, 7)
    message = refused(capsys, "study", str(path), "-o", str(done[1]), "--resume")
    assert "results of another study, or of this one before it changed" in message
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").write_text("x")
    message = refused(capsys, "study", str(path), "-o", str(tmp_path / "mine"))
    assert "has thesis.tex, but no results of a study" in message
    assert sorted(own.name for own in (tmp_path / "mine").iterdir()) == ["lock", "thesis.tex"]


# -- what befalls processes ----------------------------------------------------------------------


def children(pid):
    """Python processes that a process has started."""
    found = []
    for own in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, parent = own.read_text().rpartition(")")[2].split()[:2]
            words = (own.parent / "cmdline").read_text()
        except OSError:
            continue
        if int(parent) == pid and state != "Z" and "spawn_main" in words:
            found.append(int(own.parent.name))
    return found


def ended(pid):
    """A process is gone, or waits for init to take its exit status."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except OSError:
        return True


linux = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks into /proc")


@linux
def test_workers_killed_at_random_lose_no_row(tmp_path):
    count, most, killed, chance, before = 64, 5, 0, random.Random(1), -1
    out = tmp_path / "out"
    client = started(write(tmp_path, count), "-o", out, "--jobs", "2")
    while client.poll() is None and killed < most:
        time.sleep(chance.uniform(0.02, 0.25))
        parts = len(list((out / "rows").glob("*.parquet")))
        if killed % 3 == 0 and parts == before:
            continue  # on a slow machine workers would not even start between two kills
        workers = children(client.pid)
        if workers:
            before = parts
            try:
                os.kill(chance.choice(workers), signal.SIGKILL)
            except ProcessLookupError:
                continue
            killed += 1
    _, err = client.communicate(timeout=300)
    assert client.returncode == 0, err
    assert killed == most
    assert keys(out) == every(count)
    assert not temporary(tmp_path)


@linux
def test_a_client_that_is_killed_leaves_whole_rows_and_no_workers(tmp_path):
    path, out = write(tmp_path, 48), tmp_path / "out"
    client = started(path, "-o", out, "--jobs", "2")
    while not list((out / "rows").glob("*.parquet")) and client.poll() is None:
        time.sleep(0.01)
    workers = children(client.pid)
    client.kill()
    client.communicate()
    before = keys(out)  # every file can be read
    assert 0 < sum(before.values()) < 96
    assert max(before.values()) == 1
    again = subprocess.run(
        command(path, "-o", out, "--resume", "--jobs", "1"), capture_output=True, text=True
    )
    assert again.returncode == 0, again.stderr
    fresh = int(re.search(r"96 rows, (\d+) of them new", again.stdout)[1])
    assert fresh == 96 - sum(before.values())
    assert keys(out) == every(48)
    assert all(map(ended, workers))


@linux
def test_ctrl_c_keeps_what_is_finished(tmp_path):
    path, out = write(tmp_path, 120), tmp_path / "out"
    client = started(path, "-o", out, "--jobs", "2")
    while not list((out / "rows").glob("*.parquet")) and client.poll() is None:
        time.sleep(0.01)
    client.send_signal(signal.SIGINT)
    _, err = client.communicate(timeout=20)
    assert client.returncode == 130
    assert err == "polefence: interrupted; finished rows are kept, --resume goes on\n"
    assert max(keys(out).values()) == 1
    assert not temporary(tmp_path)


def test_two_clients_do_not_share_a_store(tmp_path, capsys):
    path, out = write(tmp_path, 3), tmp_path / "out"
    with Store(out).locked():
        message = refused(capsys, "study", str(path), "-o", str(out))
    assert "another process is adding rows to it" in message
    assert main(["study", str(path), "-o", str(out), "--jobs", "1"]) == 0
    assert keys(out) == every(3)


@linux
def test_a_full_disk_leaves_no_half_file(tmp_path):
    """Files of more than 7 kB are refused: a proof is smaller than that, rows of many are not."""
    import resource

    path, out = write(tmp_path, 20), tmp_path / "out"
    limits = (7000, 7000)
    client = started(
        path, "-o", out, "--jobs", "1",
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, limits),
    )  # fmt: skip
    _, err = client.communicate(timeout=60)
    assert client.returncode == 2
    assert "cannot be written: File too large" in err
    assert err.count("\n") == 1
    assert list((out / "proofs").rglob("*.json"))
    assert not list((out / "rows").iterdir())
    assert not temporary(tmp_path)
    assert main(["study", str(path), "-o", str(out), "--resume", "--jobs", "1"]) == 0
    assert keys(out) == every(20)


# -- what befalls files ---------------------------------------------------------------------------


def changed(results, change):
    """Put rows that are changed into the place of those that are there."""
    put_rows(results, change(list(Store(results).rows())))


def of(rows, question):
    return next(row for row in rows if row["question"] == question)


def first(**new):
    """Other values in the first row, with a digest that fits."""
    return lambda rows: [signed(rows[0], **new), *rows[1:]]


def _better(rows):
    own = of(rows, "tightest")
    return [signed(row, bound=row["bound"] - 0.01) if row is own else row for row in rows]


def _swapped(rows):
    one, two = (row for row in rows if row["question"] == "wide" and row["variant"] < 2)
    others = [row for row in rows if row is not one and row is not two]
    keys = ("proof", "law", "claim")
    return [signed(one, **{key: two[key] for key in keys}), two, *others]


def _answered_otherwise(rows):
    own = of(rows, "wide")
    other = next(
        row for row in rows if row["question"] == "tightest" and row["variant"] == own["variant"]
    )
    others = [row for row in rows if row is not own]
    return [signed(own, **{key: other[key] for key in ("proof", "law", "claim")}), *others]


CHANGES = {
    "a number, and no new digest": (
        lambda rows: [rows[0] | {"seconds": 1.0}, *rows[1:]],
        "is not as it was written: its digest differs",
    ),
    "a better bound": (_better, "its bound is none of its file"),
    "a better claim": (first(claim="poles in disk(-40, 1)"), "claims another thing than its file"),
    "the proof of another variant": (_swapped, "its file is about another plant"),
    "an answer to another question": (_answered_otherwise, "its file is not about disk(-40, 39)"),
    "another input": (first(m2=26.0), "has another m2 than"),
    "no proof": (first(proof=""), "names no proof"),
    "a row twice": (lambda rows: [*rows, rows[0]], "is given twice"),
    "a variant that there is not": (first(variant=77), "is of no variant of the study"),
    "a question that there is not": (first(question="ride"), "is of no question of the study"),
    "a failure as a success": (first(status="not proved"), "names a proof"),
}


@pytest.mark.parametrize("name", CHANGES)
def test_a_changed_row_is_found(name, results, capsys):
    change, said = CHANGES[name]
    changed(results, change)
    out = ran(capsys, "study", results, "--check", "--jobs", "1", status=1)
    assert said in out
    assert "; 1 faults" in out


def test_a_changed_proof_is_found(results):
    paths = sorted((results / "proofs").rglob("*.json"))
    with rewritten(paths[0]) as document:
        document["polefence"] = "9"
    paths[1].unlink()
    faults = sorted(own.fault for own in judged(Store(results), processes(1)) if own.fault)
    assert len(faults) == 2
    assert "cannot be read: No such file" in faults[0]
    assert faults[1] == "its file of claims is not as it was written"


def test_a_file_that_proves_nothing_is_found(results):
    """A better radius in the file too, and all digests put right."""
    store = Store(results)

    def change(rows):
        own = of(rows, "tightest")
        document = json.loads(store.proof(own["proof"]).read_text())
        document["claims"][0]["region"]["radius"] = own["bound"] * 0.9
        digest = put_proof(results, json.dumps(document).encode())
        new = signed(own, proof=digest, bound=own["bound"] * 0.9)
        return [new if row is own else row for row in rows]

    changed(results, change)
    (fault,) = [own.fault for own in judged(store, processes(1)) if own.fault]
    assert "its claims are undecided" in fault or "its claims are refuted" in fault


def test_rows_that_are_no_parquet_are_refused(results, capsys):
    path = sorted((results / "rows").iterdir())[0]
    path.write_bytes(path.read_bytes()[:100])
    assert f"{path}: not a Parquet file" in refused(capsys, "study", str(results))


# -- what cannot be asked -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('ask = "tightest"', 'ask = "tightets"', "question 1: ask = 'tightets' is unknown"),
        ('ask = "tightest"', 'ask = "tightest"\nspeed = 3', "question 1: unknown key 'speed'"),
        ("centre = -40", "", "question 1: centre is missing; write centre = -40"),
        ("centre = -40", 'centre = -40\nof = "sector"', "centre belongs to a disk"),
        ("centre = -40", "centre = -40\ndegree = 2\nmethod = 'quadratic'", "degree belongs to"),
        ("disk(-40, 39)", "disc(-40, 39)", "question 2: "),
        ('name = "wide"', 'name = "tightest"', "two questions are called 'tightest'"),
        ('name = "wide"', "name = 3", "question 2: name = 3 must be text"),
        ('base = "car.toml"', "", 'base is missing; write base = "car.toml"'),
        ('base = "car.toml"', 'base = "bus.toml"', "bus.toml: cannot be read"),
        ("[variants]", "[variant]", "unknown key 'variant'"),
        ("of = {m2", "of = {m3", "the base has no number 'm3'"),
        ("count = 4", "count = 1000000000", "1000000000 of them; a study has at most"),
        ('name = "hatchbacks"', "name = 3", "name = 3 must be text"),
    ],
)
def test_bad_studies_are_one_line_before_anything_runs(old, new, said, tmp_path, capsys):
    path = write(tmp_path)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    message = refused(capsys, "study", str(path), "-o", str(tmp_path / "out"))
    assert said in message
    assert not (tmp_path / "out").exists()


def test_options_that_do_not_go_together(done, capsys):
    path, out = done
    for words, said in (
        ([path], "-o RESULTS is missing"),
        ([path, "--check"], "--check is for a folder of results"),
        ([path, "--html", "x"], "--html is for a folder of results"),
        ([path, "--variant", "9"], "--variant = 9: there are 0 to 3"),
        ([path, "--jobs", "0"], "--jobs = 0 must be at least 1"),
        ([out, "--estimate"], "--estimate is for a study"),
        ([out, "--best", "tight"], "--best 'tight': "),
        ([out, "--best", "wide"], "no row of wide has a bound"),
        ([out / "rows"], "study.json: cannot be read"),
    ):
        assert said in refused(capsys, "study", *map(str, words))
