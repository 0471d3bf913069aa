"""The command `python -m finloop.gait`."""

import sys

from finloop.gait.tool import main

sys.exit(main())
