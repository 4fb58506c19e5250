"""The checker alone, under a bare Python: many files in one process."""

import json
import subprocess
import sys

BARE = [sys.executable, "-S", "-I"]

# The archive's own command, many times: Python compiles the archive anew each time it is run.
MANY = """
import contextlib, io, json, sys
sys.path.insert(0, sys.argv[1])
from polefence.proof.__main__ import main
found = []
for words in json.load(sys.stdin):
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = main(words)
    found.append((status, out.getvalue(), err.getvalue()))
print(json.dumps(found))
"""


def many(checker, each):
    """Exit status, output and error output for each list of words."""
    words = json.dumps([list(map(str, own)) for own in each])
    command = [*BARE, "-c", MANY, str(checker)]
    done = subprocess.run(command, input=words, capture_output=True, text=True, check=True)
    return json.loads(done.stdout)
