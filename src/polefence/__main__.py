"""``python -m polefence`` is the command line."""

import sys

from polefence.cli import main

sys.exit(main())
