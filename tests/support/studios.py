"""Subjects of the studio, read from files as the command reads them."""

from functools import cache
from pathlib import Path

from polefence.examples import spec_path
from polefence.studio import Question, Subject


@cache
def subject(name="quarter-car-physical"):
    """That of an example."""
    return Subject.read(spec_path(name))


def written(folder, text, name="car.toml"):
    """That of a text, which is put into a folder."""
    path = Path(folder, name)
    path.write_text(text)
    return Subject.read(path)


def asked(region, own=None, **more):
    """A question of what the spec has its law measure."""
    return Question(region, (own or subject()).measured, **more)
