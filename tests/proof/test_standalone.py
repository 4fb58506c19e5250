"""The checker alone: every kind of file, under a bare Python, as `polefence check` says it."""

from __future__ import annotations

import io
import json
import subprocess
import zipfile

import pytest

from polefence.cli.check import archive
from polefence.cli.main import main
from polefence.proof.document import EARLIER
from support.every_file import FILES
from support.standalone import BARE, many


@pytest.fixture(scope="module")
def checker(tmp_path_factory):
    path = tmp_path_factory.mktemp("checker") / "polefence-check.pyz"
    assert main(["check", "--standalone", str(path)]) == 0
    return path


@pytest.fixture(scope="module")
def answers(checker, every_file):
    """What the checker says of every file."""
    return dict(zip(FILES, many(checker, [[every_file / name] for name in FILES]), strict=True))


def run(checker, *words):
    command = [*BARE, str(checker), *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_nothing_else_is_there():
    """Neither numpy nor the package can be imported by the Python that runs it."""
    for name in ("numpy", "scipy", "polefence"):
        done = subprocess.run([*BARE, "-c", f"import {name}"], capture_output=True, check=False)
        assert done.returncode == 1


@pytest.mark.parametrize("name", FILES)
def test_it_proves_what_check_proves(answers, every_file, capsys, name):
    path = every_file / name
    status, out, err = answers[name]
    assert (status, err) == (0, "")
    assert main(["check", str(path)]) == 0
    said = capsys.readouterr().out.splitlines()
    mine = out.splitlines()
    assert mine == said[: len(mine)]
    assert len(mine) == 1 + len(json.loads(path.read_text())["claims"])


def test_the_archive_says_what_its_command_does(checker, answers, every_file):
    name = FILES[0]
    done = run(checker, every_file / name)
    assert [done.returncode, done.stdout, done.stderr] == answers[name]


def test_what_is_not_proved(checker, every_file, tmp_path):
    document = json.loads((every_file / "quadratic" / "design.json").read_text())
    document["claims"][0]["region"]["radius"] = 0.5
    path = tmp_path / "narrow.json"
    path.write_text(json.dumps(document))
    done = run(checker, path)
    assert done.returncode == 1
    first, claim = done.stdout.splitlines()
    assert first.startswith(f"{path}: not proved: inequality at vertex 1 is not positive definite")
    assert claim.startswith("  claimed, not proved: poles in disk(-3, 0.5)")


def test_what_cannot_be_read_is_one_line(checker, every_file, tmp_path):
    text = (every_file / "quadratic" / "design.json").read_text()
    old = [json.dumps({"format": name, "version": 1}) for name in EARLIER]
    words = []
    for bad in ("", text[:500], "[" * 10**6, text.replace('"K"', '"L\\u001b[2J"'), *old):
        words.append([tmp_path / f"bad{len(words)}.json"])
        words[-1][0].write_text(bad)
    others = [[], ["a", "b"], [tmp_path], [tmp_path / "none.json"]]
    found = many(checker, [*words, *others])
    for status, out, err in found:
        assert status == 2
        assert err.count("\n") == 1
        assert err[:-1].isprintable()
        assert not out
    assert all("polefence 0.1" in err for _, _, err in found[4 : len(words)])
    for own, answer in zip((words[0], others[0]), (found[0], found[len(words)]), strict=True):
        done = run(checker, *own)
        assert [done.returncode, done.stdout, done.stderr] == answer


def test_the_same_sources_give_the_same_bytes(checker):
    assert archive() == archive() == checker.read_bytes()
    with zipfile.ZipFile(io.BytesIO(archive())) as whole:
        assert all(entry.date_time == (1980, 1, 1, 0, 0, 0) for entry in whole.infolist())
        names = whole.namelist()
    assert names == sorted(names)
    rest = {name for name in names if not name.startswith("polefence/proof/")}
    assert rest == {"__main__.py", "polefence/__init__.py"}
