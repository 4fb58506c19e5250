"""Commands as tests run them: in this process."""

from polefence.cli.main import main


def refused(capsys, *words):
    """Run a command that refuses; return its one line."""
    try:
        status = main([str(word) for word in words])
    except SystemExit as leaving:
        status = leaving.code
    said = capsys.readouterr()
    assert status == 2, said
    assert said.out == ""
    assert said.err.count("\n") == 1
    return said.err
