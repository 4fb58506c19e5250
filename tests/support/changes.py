"""Files of claims with one value changed, and what their blocks say in floats."""

import copy

import numpy as np

from support.files import first


def changed(document, *keys, value):
    """The document with another value at the place of these keys, or what `value` makes of it."""
    document = copy.deepcopy(document)
    place = document
    for key in keys[:-1]:
        place = place[key]
    place[keys[-1]] = value(place[keys[-1]]) if callable(value) else value
    return document


def scaled(document, path, factor, shift):
    """The document with the number at a path times a factor and shifted."""

    def other(old):
        number = eval(old) if isinstance(old, str) else old  # a "p/q" of our own
        return number * factor + shift

    return changed(document, *path, value=other)


def entries(document):
    """Paths of every number that a claim about poles rests on, but for degrees of polynomials."""
    found = []

    def walk(value, path):
        if isinstance(value, dict):
            for key, item in value.items():
                walk(item, (*path, key))
        elif isinstance(value, list):
            for index, item in enumerate(value):
                walk(item, (*path, index))
        elif path[-1] not in ("degree", "elevation") and (
            type(value) in (int, float) or (isinstance(value, str) and "/" in value)
        ):
            found.append(path)

    walk(document["law"], ("law",))
    for section in ("region", "evidence"):
        walk(first(document)[section], ("claims", 0, section))
    for j, vertex in enumerate(document["plant"]["vertices"]):
        walk({k: vertex[k] for k in "AB"}, ("plant", "vertices", j))
    return found


def least_eigenvalue(claim):
    """The smallest of all blocks of a claim, each scaled to unit diagonal; -1 without one.

    And where a matrix that ought to be is not symmetric, or tau is negative.
    """
    if any(e.tau < 0 for e in claim.evidence):
        return -1.0
    if any([list(row) for row in zip(*X, strict=True)] != X for _, X in claim.symmetric()):
        return -1.0
    least = np.inf
    for _, block in claim.blocks():
        top = max(abs(e) for row in block for e in row)
        M = np.array(
            [
                [float(e / top) if top < 2**900 else e // (top >> 60) / 2**60 for e in row]
                for row in block
            ]
        )
        diagonal = np.diag(M)
        if np.any(diagonal <= 0):
            return -1.0
        scale = 1 / np.sqrt(diagonal)
        least = min(least, np.linalg.eigvalsh(M * np.outer(scale, scale))[0])
    return least
