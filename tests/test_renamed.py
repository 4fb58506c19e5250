"""Old names: each warns, names the new one and the version without it, and does the same."""

import json
import re
import warnings
from contextlib import contextmanager

import numpy as np
import pytest

import polefence as pf
from polefence.base.renamed import GONE
from polefence.cli.main import main
from support.paths import DOCS, ROOT


@contextmanager
def warned(old, new):
    text = rf"^{re.escape(old)} is now {re.escape(new)}; the old name goes in version {GONE}$"
    with pytest.warns(DeprecationWarning, match=text) as seen:
        yield
    assert len(seen) == 1
    assert seen[0].filename == __file__  # that of the caller


@pytest.fixture(scope="module")
def stage():
    m = pf.Parameter("m", 1, 2, "kg", through="1/m")
    return pf.UncertainPlant.from_expressions(
        [m], [[0, 1], ["-3/m", "-1/m"]], [[0], ["1/m"]], [[0], ["1/m"]],
        states=("place [m]", "speed [m/s]"), inputs=("force [N]",), disturbances=("push [N]",),
    )  # fmt: skip


def test_rows_and_margins_have_an_answer(stage):
    (row,) = pf.limits(stage, [-3.0], ["quadratic"], bounds=False)
    margin = next(iter(pf.in_service(pf.place(stage, pf.HalfPlane(0.5)))))
    for own, name in ((row, "Limit"), (margin, "Margin")):
        assert (own.answer, own.proved) == ("proved", True)
        with warned(f"{name}.status", f"{name}.answer"):
            assert own.status == own.answer


def test_a_row_of_a_trade_off_is_saved_as_its_design(stage, tmp_path):
    least, limit = pf.Rms("place"), pf.Rms("force", at_most=5.0)
    front = pf.tradeoff(stage, least, limit, [5.0], methods=["quadratic"])
    design = front.design(5.0, "quadratic")
    assert front.rows[0]["answer"] == "proved"
    new = design.save(tmp_path / "new")
    with warned("Front.save", "Front.design(value, method).save(directory)"):
        old = front.save(5.0, "quadratic", tmp_path / "old")
    assert old.read_bytes() == new.read_bytes()
    assert json.loads(new.read_text()) == front.file(5.0, "quadratic").write()
    assert len(pf.check(tmp_path / "new").claims) == 3


def test_what_is_saved_is_saved_into_a_folder(tmp_path):
    plant = pf.UncertainPlant.from_vertices(
        [[[0, 1], [-4, -0.5]]], [[[0], [1]]], [[[0], [1]]], inputs=("force",)
    )
    limits = [pf.Rms("x1", at_most=0.01), pf.Rms("force", at_most=0.01)]
    found = pf.refute_limits(plant, limits)
    assert found is not None
    path = found.save(tmp_path / "folder")
    assert path == tmp_path / "folder" / "limit.json"
    with warned("save(FILE.json)", "save(FOLDER), which writes limit.json there"):
        assert found.save(tmp_path / "mine.json") == tmp_path / "mine.json"
    assert (tmp_path / "mine.json").read_bytes() == path.read_bytes()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        (tmp_path / "a.json").mkdir()
        assert found.save(tmp_path / "a.json").parent == tmp_path / "a.json"
    assert pf.check(path).proved


def test_verify_is_analyse(stage, tmp_path):
    gain, inside, limit = [[-1.0, -1.0]], pf.HalfPlane(0.1), pf.Rms("place", at_most=9.0)
    new = pf.analyse(stage, gain, inside, limits=[limit], lyapunov=[np.eye(2)])
    with warned("verify", "analyse"):
        old = pf.verify(stage, gain, inside, [np.eye(2)], [limit])
    with warned("Verified", "Analysis"):
        assert type(old) is pf.Verified
    assert (old.answer, old.reason) == (new.answer, new.reason)
    assert old.bounds[0].bound.level == new.bounds[0].bound.level
    assert old.lyapunov == new.lyapunov
    with warned("Verified.analysis", "Analysis"):
        alone = old.analysis
    assert (alone.answer, alone.bounds) == ("proved", ())
    assert len(pf.check(new.save(tmp_path)).claims) == 2  # region and bound


def test_old_names_are_not_listed():
    assert not {"verify", "Verified"} & {*pf.__all__, *dir(pf)}


PAGES = [*DOCS.rglob("*.md"), *DOCS.glob("examples/*.py"), ROOT / "README.md"]
OLD = re.compile(
    r"\b(?:pf|polefence)\.verify\b|\bVerified\b|\bfront\.save\(|\b(?:row|margin)\.status\b"
    r"|\.save\([\"'][^\"']*\.json[\"']\)|\bexceeded: "
)


def test_no_page_uses_an_old_name():
    assert OLD.search("found = pf.verify(plant, K, region)")
    assert OLD.search('law.save("law.json")')
    assert len(PAGES) > 60
    for page in PAGES:
        if page.name != "changelog.md" and "_build" not in page.parts:
            assert not OLD.search(page.read_text()), page


def test_both_names_of_the_command_are_one(capsys):
    helps = []
    for name in ("analyse", "verify"):
        with pytest.raises(SystemExit):
            main([name, "--help"])
        helps.append(capsys.readouterr().out.partition("options:")[2].partition("examples:")[0])
    assert "--lyapunov" in helps[0]
    assert helps[0] == helps[1]
    with pytest.raises(SystemExit):
        main(["--help"])
    assert "the same as analyse" in " ".join(capsys.readouterr().out.split())
