"""The command `python -m finloop.morph`."""

import sys

from finloop.morph.tool import main

sys.exit(main())
