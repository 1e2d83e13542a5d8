"""The command ``fdm``, from the same wheel."""

from __future__ import annotations

import signal
import sys

from . import _fdm


def main() -> int:
    """Does what the command line asks for; the exit code."""
    # Ctrl-C is the command's own matter: it ends a fit with the best so far, and everything else at once
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    return _fdm.command(["fdm", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
