"""``python -m tdcr_fe`` is the command ``tdcr-fe``."""

import sys

from tdcr_fe.cli import main

if __name__ == "__main__":
    sys.exit(main())
