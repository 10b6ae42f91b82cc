"""The program ``vibroimpact``: the same as the one in Rust."""

import signal
import sys

from . import _native


def main() -> int:
    """Obey the command line; the exit status of the program."""
    # Ctrl-C is for the program in Rust to see: what had ended is kept, and files appear whole or not at all.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    sys.stdout.flush()
    return _native.main(["vibroimpact", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
