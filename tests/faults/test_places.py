"""Where results go: over nothing of others, through no link, and whole or not at all."""

from __future__ import annotations

import errno
import os
import subprocess
import sys

import pytest

from polefence import OutputError, export
from polefence.base.files import write_all
from polefence.certify.design import FILE_NAME
from polefence.cli.main import main
from polefence.export.sources import cell, prose
from polefence.plant.spec import dumps

SPEC = "[[vertex]]\nA = [[1]]\nB = [[1]]\n"


@pytest.fixture
def spec(tmp_path):
    path = tmp_path / "spec.toml"
    path.write_text(SPEC)
    return str(path)


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


COMMANDS = {
    "design": (["design", "SPEC", "--disk", "-3", "1", "-o", "OUT"], FILE_NAME),
    "tightest": (["tightest", "SPEC", "--of", "half-plane", "-o", "OUT"], FILE_NAME),
    "analyse": (
        ["analyse", "SPEC", "--gain", "[[-4]]", "--region", "half_plane(1)", "-o", "OUT"],
        FILE_NAME,
    ),
    "observe": (
        ["observe", "NAMED", "--measured", "x", "--disk", "-3", "1", "-o", "OUT"],
        FILE_NAME,
    ),
    "optimise": (
        ["optimise", "SPEC", "--limit", "gain norm of the law <= 9", "-o", "OUT"],
        "design.json",
    ),
}


@pytest.mark.parametrize("command", COMMANDS)
def test_a_file_of_others_is_not_overwritten(command, spec, tmp_path, capsys):
    words, name = COMMANDS[command]
    named = tmp_path / "named.toml"
    named.write_text(f'states = ["x"]\n{SPEC}')
    folder = tmp_path / "out"
    folder.mkdir()
    target = folder / name
    put = {"SPEC": spec, "NAMED": str(named), "OUT": str(folder)}
    words = [put.get(word, word) for word in words]
    target.write_text('{"name": "my own design", "mass": 3}\n')
    before = contents(folder)
    assert main(words) == 2
    assert "not a Polefence file" in capsys.readouterr().err
    assert contents(folder) == before
    elsewhere = tmp_path / "elsewhere.json"
    elsewhere.write_text('{"format": "polefence-design"}')
    target.unlink()
    target.symlink_to(elsewhere)
    assert main(words) == 2
    assert "is a symbolic link" in capsys.readouterr().err
    assert elsewhere.read_text() == '{"format": "polefence-design"}'
    target.unlink()
    assert main(words) == 0
    assert main(words) == 0  # over its own


def test_python_too_writes_over_none_but_ours(small_designs, tmp_path):
    (tmp_path / FILE_NAME).write_text("mine")
    with pytest.raises(OutputError, match="not a Polefence file"):
        small_designs["slack"].save(tmp_path)
    assert contents(tmp_path) == {FILE_NAME: b"mine"}


@pytest.mark.parametrize("fails", [1, 2, 5])
def test_a_full_disk_leaves_no_half_export(fails, small_designs, tmp_path, monkeypatch):
    """The disk is full at the file of this number; what was there before is there afterwards."""
    found = export.export_c99(small_designs["quadratic"])
    old = tmp_path / "old"
    found.save(old)
    before = contents(old)
    real, count = os.fdopen, [0]

    def full(*args, **kwargs):
        file = real(*args, **kwargs)
        count[0] += 1
        if count[0] == fails:

            def write(content, own=file.write):
                own(content[:10])
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

            class Full:
                def __enter__(self):
                    return self

                def __exit__(self, *_):
                    file.close()

            Full.write = staticmethod(write)
            return Full()
        return file

    monkeypatch.setattr("polefence.base.files.os.fdopen", full)
    with pytest.raises(OutputError, match="No space left"):
        found.save(tmp_path / "new")
    assert not (tmp_path / "new").exists()
    count[0] = 0
    other = export.export_c99(small_designs["quadratic"], limits=5)
    with pytest.raises(OutputError, match="No space left"):
        other.save(old)
    assert contents(old) == before
    monkeypatch.undo()
    other.save(old)
    assert contents(old) != before


def test_an_interrupt_leaves_nothing(tmp_path, monkeypatch):
    def stop(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("polefence.base.files.os.replace", stop)
    with pytest.raises(KeyboardInterrupt):
        write_all(tmp_path / "new", {"a": b"1", "b": b"2"})
    assert list(tmp_path.iterdir()) == []


KILLED = """
import os, sys
real, count = os.replace, [0]
def replace(*names):
    count[0] += 1
    if count[0] == int(sys.argv[1]):
        os._exit(9)
    real(*names)
os.replace = replace
from polefence.cli.main import main
main(sys.argv[2:])
"""


@pytest.mark.parametrize("after", [1, 3])
def test_a_killed_export_does_not_block_the_next(after, spec, tmp_path, capsys):
    assert main(["design", spec, "--disk", "-3", "1", "-o", str(tmp_path / "d")]) == 0
    folder = tmp_path / "code"
    words = ["export", str(tmp_path / "d"), "-o", str(folder)]
    done = subprocess.run([sys.executable, "-c", KILLED, str(after), *words], check=False)
    assert done.returncode == 9
    left = [name for name in contents(folder) if name.startswith(".")]
    assert left
    assert main(words) == 0
    assert not [name for name in contents(folder) if name.startswith(".")]
    assert main(["check", str(folder)]) == 0
    # but a hidden file of others still does
    (folder / ".law.c.mine").write_text("")
    assert main(words) == 2
    assert ".law.c.mine: not a file of this export" in capsys.readouterr().err


def test_an_export_writes_through_no_link(spec, tmp_path, capsys):
    assert main(["design", spec, "--disk", "-3", "1", "-o", str(tmp_path / "d")]) == 0
    folder = tmp_path / "code"
    words = ["export", str(tmp_path / "d"), "-o", str(folder)]
    assert main(words) == 0
    elsewhere = tmp_path / "elsewhere.c"
    (folder / "law.c").rename(elsewhere)
    (folder / "law.c").symlink_to(elsewhere)
    before = elsewhere.read_bytes()
    assert main([*words, "--float", "32"]) == 2
    assert "law.c: not a file of this export" in capsys.readouterr().err
    assert elsewhere.read_bytes() == before


HOSTILE = "<script>alert(1)</script> & ![x](http://a/b.png) [y](javascript:z) [r][s] <b"


def test_what_strangers_write_is_no_markup():
    for made in (prose(HOSTILE), cell(HOSTILE)):
        assert "<" not in made
        assert "](" not in made
        assert "][" not in made
        assert "&lt;script&gt;" in made
        assert "&amp; !" in made
    assert "|" not in cell("a|b")


def test_an_exported_readme_has_no_markup_of_strangers(tmp_path):
    from dataclasses import replace

    from polefence import Disk, UncertainPlant, place

    plant = UncertainPlant.from_vertices(
        [[[1]]], [[[1]]], name=HOSTILE, states=(HOSTILE + " [m]",), inputs=("<i>",)
    )
    assert dumps(replace(plant, name="x"))
    export.export_c99(place(plant, Disk(-3, 1), "quadratic")).save(tmp_path / "code")
    page = (tmp_path / "code" / "README.md").read_text()
    body = page.split("\n", 1)[1]  # the first line is the mark, a comment
    assert "<" not in body.replace("#include <", "")
    assert "](" not in body
