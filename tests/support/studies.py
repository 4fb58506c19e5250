"""Rows of studies as tests change them: written anew, with digests that fit."""

import hashlib
from collections import Counter

from polefence.fleet import Store
from polefence.fleet.store import _table, digest_of


def keys(results):
    """How often each variant and question has a row."""
    return Counter((row["variant"], row["question"]) for row in Store(results).rows())


def signed(row, **new):
    """A row with other values, and the digest of these."""
    row = row | new
    return row | {"digest": digest_of(row)}


def put_rows(results, rows):
    """Put these rows into the place of all that there are."""
    names = Store(results).about["names"]
    for path in (results / "rows").iterdir():
        path.unlink()
    (results / "rows" / "all.parquet").write_bytes(_table(rows, names))


def put_proof(results, content):
    """Put a file of claims into the store; return its digest."""
    digest = hashlib.sha256(content).hexdigest()
    path = Store(results).proof(digest)
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(content)
    return digest
