"""The commands of the page "What it does", to be run as they are written."""

import re
import shlex
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path

from polefence.cli.main import main
from support.browser import studio
from support.paths import DOCS

PAGE = (DOCS / "what-it-does.md").read_text()
ROWS = re.findall(r"^\|[^|]*\|([^|]*polefence[^|]*)\|", PAGE, re.MULTILINE)


def commands_of(row):
    """The commands of a row, without what it says in brackets."""
    return re.findall(r"`(polefence [^`]*)`", row)


def run_as_written(commands):
    """Run them in the present folder; `> FILE` writes what they print."""
    for line in commands:
        if line.startswith("polefence studio "):  # which goes on until Ctrl-C
            with studio(Path.cwd(), *shlex.split(line)[2:]):
                continue
        command, _, target = line.partition(" > ")
        with redirect_stdout(StringIO()) as said:
            assert main(shlex.split(command)[1:]) == 0, line
        if target:
            Path(target).write_text(said.getvalue())
