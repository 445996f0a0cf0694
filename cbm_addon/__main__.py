"""`python -m cbm_addon COMMAND`."""

import sys

from .cli import main

sys.exit(main())
