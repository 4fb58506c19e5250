"""Commands as tests run them: in this process."""

from polefence.cli.main import main


def ran(capsys, *words, status=0):
    """Run a command that ends with a status; return its output, and where it fails its errors."""
    ended = main([str(word) for word in words])
    said = capsys.readouterr()
    assert ended == status, said
    return said.out + said.err if status else said.out


def refused(capsys, *words, status=2):
    """Run a command that refuses; return its one line."""
    capsys.readouterr()
    try:
        ended = main([str(word) for word in words])
    except SystemExit as leaving:
        ended = leaving.code
    said = capsys.readouterr()
    assert ended == status, said
    assert said.out == ""
    assert said.err.count("\n") == 1
    return said.err
