"""``python -m haptogram``: the command line."""

import sys

from .start import main

sys.exit(main())
