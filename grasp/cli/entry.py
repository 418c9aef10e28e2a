"""What the console command `grasp` calls: until its modules are imported Ctrl-C ends the process at
once. Nothing has been opened that would have to be cleaned up, and a KeyboardInterrupt would show
a traceback."""

import os
import signal

INTERRUPTED = 130


def _quit(*_: object) -> None:
    os._exit(INTERRUPTED)


if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(signal.SIGINT, _quit)


def main() -> int:
    from grasp.cli.main import main as command

    try:
        return command()  # which takes signals itself
    finally:
        if signal.getsignal(signal.SIGINT) is _quit:
            signal.signal(signal.SIGINT, signal.default_int_handler)
