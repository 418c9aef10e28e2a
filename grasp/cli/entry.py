"""Entry point of the console command `grasp`. Until its modules are imported, Ctrl-C ends the
process at once: nothing needs clean-up yet, and a KeyboardInterrupt would show a traceback."""

import os
import signal
import sys

INTERRUPTED = 130


def _quit(*_: object) -> None:
    os._exit(INTERRUPTED)


if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(signal.SIGINT, _quit)


def main() -> int:
    from grasp.cli.main import main as command

    try:
        return command()  # it handles signals itself
    finally:
        if signal.getsignal(signal.SIGINT) is _quit:  # a held key must not change the exit code
            signal.signal(signal.SIGINT, signal.SIG_IGN)


if __name__ == "__main__":
    sys.exit(main())
