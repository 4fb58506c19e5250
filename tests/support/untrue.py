"""Changed files of claims: what `check` accepts is held against samples.

A change is of one number, of several, of a whole matrix, of a key or a word, of an entry of a list,
or it puts a part of another file in the place of one. A claim's limit is besides moved as far as
`check` lets it: there the claim is nearest to false. `benchmarks/untrue.py` tries thousands.
"""

import copy
import json
import random
import time
from collections import Counter

from polefence.proof.document import check, from_plain
from polefence.proof.work import FormatError
from support.truths import false

WHOLE = ("degree", "elevation", "terms", "delay", "bits", "held_degree", "vertex", "input")
# Limits of claims, and whether a larger number claims more.
LIMITS = {
    "level": False, "radius": False, "decay": True, "error": True, "height": False,
    "real": False, "imaginary": False, "damping": True, "factor": True, "intensity": True,
    "norm": True, "sample_time": True,
}  # fmt: skip
STEPS = 7  # of the bisection of a limit
# Keys that a claim, its evidence, a law or a plant may have, and values to try.
EXTRA = {
    "on": ("box", "simplex"), "transfer": (True,), "own": (True,), "elevation": (0, 1, 3),
    "degree": (0, 1, 2), "tau": (0, 1), "epsilon": (0.1,), "scale": (1, 1e-3), "delay": (0, 1),
    "rate": ("any", [-1, 1]), "rates": ("any",), "pieces": ([1], [4]), "sample_time": (1e-3, 0.1),
    "kind": ("rms", "energy peak", "gain", "initial peak", "saturation", "relative rms", "region",
             "estimate", "rate", "gain error", "observer", "rounding", "sampled", "fixed"),
    "method": ("quadratic", "slack", "scheduled", "lyapunov"), "part": (2,), "factor": (10,),
    "intensity": (0, 4), "norm": (0, 3), "impulses": ([3],), "norms": ([2],), "prompt": (1,),
    "early": (0, 0.25, 0.5, 0.99, 1, -0.5, 1.5),
    "disturbances": ([0], [2], [1, 0]), "measured": (["x"], ["v", "x"], []),
    "parameters": ([],), "filters": ([{}],), "states": ([1], [2, 1], ["v", "x"]),
}  # fmt: skip


def nodes(node, path=()):
    """Every value below, with its path."""
    yield path, node
    if isinstance(node, dict | list):
        for key, value in node.items() if isinstance(node, dict) else enumerate(node):
            yield from nodes(value, (*path, key))


def is_number(value):
    """Whether a file's value is a number, or text "p/q"."""
    if isinstance(value, str):
        return value.strip("-").replace("/", "").isdigit()
    return isinstance(value, int | float) and not isinstance(value, bool)


def parts(document):
    """All that a proof reads, with paths."""
    for key in ("plant", "law", "claims"):
        if key in document:
            yield from nodes(document[key], (key,))


def places(document):
    """Paths of every number but those of the head and of what no proof reads."""
    return [path for path, value in parts(document) if is_number(value)]


def at(document, path):
    """The value there."""
    for key in path:
        document = document[key]
    return document


def put(document, path, value):
    """Put a value there, in place."""
    at(document, path[:-1])[path[-1]] = value


def number(value):
    """The double of a file's number."""
    if not isinstance(value, str):
        return value
    top, _, bottom = value.partition("/")
    return int(top) / int(bottom or 1)


def changed(document, path, dice):
    """A number larger, smaller, of other sign, or that of another place."""
    found = copy.deepcopy(document)
    change_number(found, path, dice)
    return found


def change_number(document, path, dice):
    """Change one number, in place."""
    old = at(document, path)
    value, size = number(old), 10.0 ** dice.uniform(-3, 1)
    new = dice.choice(
        [value * (1 + size), value / (1 + size), -value, 0, value + size, value - size]
    )
    whole = type(old) is int and path[-1] in WHOLE
    put(document, path, int(new) if whole else new)


# --- changes, in place; they return whether there was anything to change -------------------------


def one_number(document, others, dice):
    """Change a number."""
    change_number(document, dice.choice(places(document)), dice)


def some_numbers(document, others, dice):
    """Change two to five numbers."""
    every = places(document)
    for path in dice.sample(every, min(dice.randint(2, 5), len(every))):
        change_number(document, path, dice)


def a_matrix(document, others, dice):
    """Scale a matrix, shift it, transpose it, or change its sign."""
    found = [
        path
        for path, value in parts(document)
        if isinstance(value, list) and value and all(map(is_row, value))
    ]
    if not found:
        return False
    path = dice.choice(found)
    rows = [[number(x) for x in row] for row in at(document, path)]
    size, turn = 10.0 ** dice.uniform(-3, 3), dice.randrange(5)
    if turn == 0:
        rows = [[x * size for x in row] for row in rows]
    elif turn == 1:
        rows = [[-x for x in row] for row in rows]
    elif turn == 2:
        rows = [[x + size * (i == j) for j, x in enumerate(r)] for i, r in enumerate(rows)]
    elif turn == 3:
        rows = [list(column) for column in zip(*rows, strict=True)]
    else:
        rows = [[0 for _ in row] for row in rows]
    put(document, path, rows)
    return True


def is_row(value):
    """Whether a value is a row of numbers."""
    return isinstance(value, list) and bool(value) and all(map(is_number, value))


def tables(document):
    """Paths of every table."""
    return [path for path, value in parts(document) if isinstance(value, dict)]


def a_key(document, others, dice):
    """Take a key out, or put one in."""
    path = dice.choice(tables(document))
    table = at(document, path)
    if table and dice.random() < 0.4:
        del table[dice.choice(sorted(table))]
    else:
        key = dice.choice(sorted(EXTRA))
        table[key] = copy.deepcopy(dice.choice(EXTRA[key]))


def a_word(document, others, dice):
    """Change a key that is there for another of its values."""
    found = [path for path, _ in parts(document) if path[-1] in EXTRA]
    if not found:
        return False
    path = dice.choice(found)
    put(document, path, copy.deepcopy(dice.choice(EXTRA[path[-1]])))
    return True


def an_entry(document, others, dice):
    """Drop an entry of a list, double it, or let two change places."""
    found = [path for path, value in parts(document) if isinstance(value, list) and len(value) > 1]
    if not found:
        return False
    rows, turn = at(document, dice.choice(found)), dice.randrange(3)
    i, j = dice.sample(range(len(rows)), 2)
    if turn == 0:
        del rows[i]
    elif turn == 1:
        rows.insert(j, copy.deepcopy(rows[i]))
    else:
        rows[i], rows[j] = rows[j], rows[i]
    return True


def a_part(document, others, dice):
    """Put a part of another file, or of the same, in the place of one of the same name."""
    source = dict(parts(dice.choice(others)))
    names = {path[-1] for path in source if isinstance(path[-1], str)}
    found = [path for path, _ in parts(document) if path[-1] in names and len(path) > 1]
    if not found:
        return False
    path = dice.choice(found)
    same = [other for other in source if other[-1] == path[-1]]
    put(document, path, copy.deepcopy(source[dice.choice(same)]))
    return True


def a_claim(document, others, dice):
    """Put the claims of another file behind, or in the place of, those that are there."""
    other = copy.deepcopy(dice.choice(others))
    document["claims"] = dice.choice([other["claims"], document["claims"] + other["claims"]])
    return True


CHANGES = {
    one_number: 6, some_numbers: 3, a_matrix: 2, a_key: 2, a_word: 1, an_entry: 2, a_part: 3,
    a_claim: 1,
}  # fmt: skip


def is_claims(document):
    """Whether it has claims."""
    claims = document.get("claims")
    return isinstance(claims, list) and bool(claims) and all(isinstance(c, dict) for c in claims)


def limits(document):
    """Paths of the limits of claims."""
    return [
        path
        for path, value in nodes(document["claims"], ("claims",))
        if path and path[-1] in LIMITS and is_number(value)
    ]


def pushed(document, path):
    """Yield the file with a limit moved towards false, each as far as `check` let the one before.

    Bisects the logarithm of the factor; what is yielded is answered by the next call of `send`.
    """
    value = number(at(document, path))
    low, high, sign = 0.0, 6.0, 1 if LIMITS[path[-1]] else -1
    if path[-1] == "damping":  # below one
        high = 0.3
    for _ in range(STEPS):
        middle = (low + high) / 2
        tried = copy.deepcopy(document)
        own = value * 2.0 ** (sign * middle)
        put(tried, path, own if value else 2.0 ** (4 * middle - 12))
        if path[-1] == "damping":
            _slope(tried, path)
        accepted = yield tried
        low, high = (middle, high) if accepted else (low, middle)


def _slope(document, path):
    """Give a sector the slope of its damping."""
    part = at(document, path[:-1])
    if 0 < part["damping"] < 1:
        part["slope"] = (1 / part["damping"] ** 2 - 1) ** 0.5


def proved(document):
    """Whether the checker says so, or that it is refuted in the cells that say so."""
    try:
        answer = check(from_plain(document))
    except FormatError:
        return False
    return bool(answer.verdicts[-1].note) if answer.answer == "refuted" else answer.proved


class Run:
    """Tries changed files, one original after another, and counts.

    ``faults`` gets (why, document) for every file that samples contradict, or cannot read.
    """

    def __init__(self, documents):
        self.documents = documents
        self.counts = {name: Counter() for name in documents}
        self.faults = []

    def of(self, name, files, seconds=float("inf"), seed=0):
        """Try so many changed files of one, or as many as there is time for; return the counts.

        The limits of the file as it is are moved first.
        """
        own, dice, start = (
            self.documents[name],
            random.Random(f"{name} {seed}"),
            time.process_time(),
        )
        assert proved(own), name
        assert not false(own), name
        for path in limits(own):
            if time.process_time() - start < seconds / 2:
                self._push(name, own, path, seed)
        while self.counts[name]["files"] < files and time.process_time() - start < seconds:
            self._change(name, dice)
        return self.counts[name]

    def _change(self, name, dice):
        """Try one changed file, and of an accepted one now and then a limit besides."""
        document = copy.deepcopy(self.documents[name])
        # a part of another file belongs where plants are of the same size
        others = [own for own in self.documents.values() if _shape(own) == _shape(document)]
        for _ in range(dice.choice([1, 1, 1, 2])):
            turn = dice.choices(list(CHANGES), list(CHANGES.values()))[0]
            turn(document, others, dice)
            if not isinstance(document.get("plant"), dict) or not is_claims(document):
                break
        seed = dice.randrange(10**6)
        every = limits(document) if self._tried(name, document, seed) else []
        if every and dice.random() < 0.5:
            self._push(name, document, dice.choice(every), seed)

    def _push(self, name, document, path, seed):
        """Move one limit of an accepted file as far as it goes."""
        tries, accepted = pushed(document, path), None
        try:
            while True:
                accepted = self._tried(name, tries.send(accepted), seed)
        except StopIteration:
            return

    def _tried(self, name, document, seed):
        """Whether a file is accepted; what samples say of it is counted."""
        count = self.counts[name]
        count["files"] += 1
        try:
            document = json.loads(json.dumps(document, allow_nan=False))
        except ValueError:  # a number that JSON does not hold
            count["refused"] += 1
            return False
        if not proved(document):
            count["refused"] += 1
            return False
        count["accepted"] += 1
        try:
            why = "false" if false(document, seed) else ""
        except Exception as problem:  # what samples cannot read is said, not hidden
            why = f"not judged, {type(problem).__name__}: {problem}"
        if why:
            count[why.partition(",")[0]] += 1
            self.faults.append((why, document))
        return True


def _shape(document):
    """Vertices and states of a file."""
    vertices = document["plant"]["vertices"]
    return len(vertices), len(vertices[0]["A"])
