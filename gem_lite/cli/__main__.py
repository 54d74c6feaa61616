"""``python -m gem_lite.cli``: the same as the command ``gem-lite``."""

import sys

from gem_lite.cli import main

if __name__ == "__main__":
    sys.exit(main())
