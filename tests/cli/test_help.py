"""Help in groups, with examples that can be typed; completion in real shells."""

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import polefence.cli
from polefence.cli.help import EXAMPLES, GROUPS
from polefence.cli.main import COMMANDS, _parser, main
from support.commands import ran

NAMES = COMMANDS


def helped(capsys, *words):
    with pytest.raises(SystemExit) as leaving:
        main([*words, "--help"])
    assert leaving.value.code == 0
    return capsys.readouterr().out


def test_every_command_is_listed_once_and_has_an_example():
    listed = [name for names in GROUPS.values() for name in names]
    rooms = Path(polefence.cli.__file__).parent.glob("*.py")
    written = [
        name
        for room in rooms
        for name in re.findall(r"^def (\w+)_command\(", room.read_text(), re.M)
    ]
    assert sorted(listed) == sorted(name.replace("_", "-") for name in written if name)
    assert EXAMPLES.keys() == set(NAMES)


@pytest.mark.parametrize("wide", [60, 80, 200])
def test_help_fits_the_terminal(capsys, monkeypatch, wide):
    monkeypatch.setenv("COLUMNS", str(wide))
    said = helped(capsys)
    for name in NAMES:
        assert re.search(rf"^  {name} +\S", said, re.MULTILINE), name
    assert max(map(len, said.splitlines()[4:-3])) <= min(wide, 100)


@pytest.mark.parametrize("name", NAMES)
def test_examples_are_at_the_end_and_can_be_typed(capsys, name):
    assert helped(capsys, name).rstrip().endswith("\n  ".join(["examples:", *EXAMPLES[name]]))
    for line in EXAMPLES[name]:
        command = re.split(r" >>? ", line)[0]
        words = shlex.split(command)
        assert words[0] == "polefence"
        assert len(line) <= 98
        _parser().parse_args([re.sub(r"^-(\d+)$", r"-\1.0", word) for word in words[1:]])
    assert any(f"polefence {name}" in line for line in EXAMPLES[name])


@pytest.mark.parametrize(
    ("typed", "wanted"),
    [
        ("polefence ver", {"verify"}),
        ("polefence verify --lya", {"--lyapunov"}),
        ("polefence completion ", {"bash", "zsh", "fish"}),
        ("polefence design ca", {"car.toml"}),
    ],
)
def test_words_are_completed(tmp_path, typed, wanted):
    """As the code for bash asks for them."""
    (tmp_path / "car.toml").write_text("")
    out = tmp_path / "out"
    own = {"_ARGCOMPLETE": "1", "_ARGCOMPLETE_IFS": "\n", "COMP_TYPE": "9", "COMP_LINE": typed}
    own |= {"COMP_POINT": str(len(typed)), "_ARGCOMPLETE_STDOUT_FILENAME": str(out)}
    command = [Path(sys.executable).with_name("polefence")]
    subprocess.run(command, env=os.environ | own, cwd=tmp_path, check=True, timeout=60)
    assert {word.strip() for word in out.read_text().split("\n")} - {"--help"} == wanted


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_code_is_one_that_the_shell_reads(capsys, tmp_path, shell):
    code = ran(capsys, "completion", shell)
    assert "_ARGCOMPLETE" in code
    assert "polefence" in code
    if shutil.which(shell):
        (tmp_path / "code").write_text(code)
        subprocess.run([shell, "-n", tmp_path / "code"], check=True, timeout=60)


def test_no_other_shell_is_known(capsys):
    with pytest.raises(SystemExit):
        main(["completion", "csh"])
    assert "invalid choice: 'csh'" in capsys.readouterr().err
