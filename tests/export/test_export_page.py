"""docs/export.md: its commands print what it shows, its examples run, its numbers are measured."""

import re
import subprocess
import sys

import pytest

from polefence.cli.main import main
from support.console import blocks, follow
from support.paths import DOCS

PAGE = (DOCS / "export.md").read_text()
PYTHON = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("page")


@pytest.mark.parametrize("block", blocks(PAGE))
def test_the_commands_print_what_the_page_shows(block, folder, monkeypatch, capsys):
    follow(block, folder, monkeypatch, capsys)


@pytest.mark.parametrize("example", range(len(PYTHON)))
def test_the_python_runs(example, folder, monkeypatch, request):
    monkeypatch.chdir(folder)
    code = PYTHON[example]
    if "fmpy" in code:
        request.getfixturevalue("host_compiler")
    subprocess.run([sys.executable, "-W", "error", "-c", code], check=True, timeout=120)


def test_the_ten_lines_compile(folder, host_compiler):
    """With what the reader is to bring: three functions and a report."""
    code = re.search(r"```c\n(.*?)```", PAGE, re.DOTALL)[1]
    own = (
        "float load_in_kg(void); float age(void); void measure(float *x);"
        "void report(void); void actuate(const float *u);\n"
    )
    (folder / "main.c").write_text(own + code)
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-Icar-c", "-c", "main.c", "-o", "main.o"]
    if not (folder / "car-c").is_dir():
        pytest.fail("the page's commands did not run")
    assert main(["export", str(folder / "car"), "--float", "32", "-o", str(folder / "car-c")]) == 0
    subprocess.run(["gcc", *flags], cwd=folder, check=True)
