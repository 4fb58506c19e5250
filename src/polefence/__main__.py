"""``python -m polefence`` is the command line."""

import sys

from polefence.cli.main import main

sys.exit(main())
