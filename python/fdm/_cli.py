"""The command ``fdm``, from the same wheel."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path

from . import _fdm


def main() -> int:
    """Does what the command line asks for; the exit code."""
    # the library that goes into functional mock-up units stands in the wheel, and not beside the interpreter
    library = next(Path(__file__).parent.glob("units/*fdm_fmu.*"), None)
    if library is not None:
        os.environ.setdefault("FDM_FMU_LIBRARY", str(library))
    # Ctrl-C is the command's own matter: it ends a fit with the best so far, and everything else at once
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    return _fdm.command(["fdm", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
