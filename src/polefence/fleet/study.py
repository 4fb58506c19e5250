"""Studies: a base spec, its variants, and the questions about each of them; all as data."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from polefence.base.errors import SpecError, shown, suggest
from polefence.base.explained import explained
from polefence.base.files import read_text
from polefence.fleet.questions import Question, read_questions
from polefence.fleet.variants import Variants, read_variants
from polefence.plant.card import card
from polefence.plant.expression import decimal, decimal_text
from polefence.plant.spec import MAX_BYTES, loads, parse
from polefence.plant.varied import numbers_of, varied
from polefence.proof.short import Short

KEYS = ("name", "base", "variants", "question")


@dataclass(frozen=True)
class Task(Short):
    """A question about some variants, which are worked out together.

    Attributes
    ----------
    question : int
    variants : tuple of int
    """

    question: int
    variants: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Study(Short):
    """A study.

    Attributes
    ----------
    name : str
    base : str
        Text of the spec that is varied.
    variants : Variants
    questions : tuple of Question
    """

    name: str
    base: str
    variants: Variants
    questions: tuple[Question, ...]

    @classmethod
    def of(cls, document: Mapping[str, Any]) -> Study:
        """Return the study that was written as `document` has it."""
        rows = [tuple(decimal(x) if x else None for x in row) for row in document["rows"]]
        variants = Variants(tuple(document["names"]), rows, document["labels"])
        questions = read_questions(document["questions"])
        return cls(document["name"], document["base"], variants, questions)

    def _repr_html_(self) -> str:
        """Show it in a notebook."""
        varied_names = ", ".join(self.variants.names)
        asked = ((question.name, question.words) for question in self.questions)
        return card(self.name, [("variants", f"{len(self.variants)}: {varied_names}"), *asked])

    @property
    def total(self) -> int:
        """Number of rows: each variant with each question."""
        return len(self.variants) * len(self.questions)

    def spec(self, number: int) -> str:
        """Return the spec of one variant."""
        return varied(self.base, self.variants.values(number), self.name)

    @cached_property
    def digest(self) -> str:
        """SHA-256 of all that its rows depend on."""
        return hashlib.sha256(json.dumps(self.document()).encode()).hexdigest()

    def document(self) -> dict[str, Any]:
        """Return it as plain data, in which equal studies are equal."""
        variants = self.variants
        rows = [["" if x is None else decimal_text(x) for x in row] for row in variants.rows]
        return {
            "name": self.name,
            "base": self.base,
            "names": list(variants.names),
            "rows": rows,
            "labels": list(variants.labels),
            "questions": [question.table() for question in self.questions],
        }

    def tried(self, question: Question) -> Study:
        """Return one question about the first variants, as many as are worked out together."""
        variants = self.variants
        few = Variants(
            variants.names, variants.rows[: question.group], variants.labels[: question.group]
        )
        return replace(self, variants=few, questions=(question,))

    def tasks(self, done: frozenset[tuple[int, str]] = frozenset()) -> Iterator[Task]:
        """Yield what is asked of variants alone, in groups, but for the rows that are done."""
        for k, question in enumerate(self.questions):
            if question.together:
                continue
            left = [n for n in range(len(self.variants)) if (n, question.name) not in done]
            for first in range(0, len(left), question.group):
                yield Task(k, tuple(left[first : first + question.group]))


@explained
def load_study(path: str | Path) -> Study:
    """Read a study from a TOML file.

    Raises
    ------
    SpecError
        If it says something that cannot be used: one line with file, key, value and remedy.
    """
    where = Path(path)
    data = parse(read_text(where, MAX_BYTES, SpecError), str(path))
    try:
        return _study(data, where.parent)
    except SpecError as error:
        raise SpecError(f"{path}: {' '.join(str(error).split())}") from error


def _study(data: dict[str, Any], folder: Path) -> Study:
    for key in data:
        if key not in KEYS:
            raise SpecError(f"unknown key {shown(key)}; {suggest(key, KEYS)}")
    if not isinstance(data.get("base"), str):
        raise SpecError('base is missing; write base = "car.toml", the spec that is varied')
    name = data.get("name", "study")
    if not isinstance(name, str):
        raise SpecError(f"name = {shown(name)} must be text")
    path = folder / data["base"]
    base = read_text(path, MAX_BYTES, SpecError)
    loads(base, str(path))
    known = numbers_of(base, str(path))
    variants = read_variants(data.get("variants"), folder, known)
    questions = read_questions(data.get("question"))
    if len(variants) * len(questions) > 10_000_000:
        raise SpecError(f"{len(variants)} variants of {len(questions)} questions: too many rows")
    return Study(name, base, variants, questions)
