"""Command line of one emulated controller: `python -m drivers.ur.emulator --host 127.0.0.2`.

Prints one line of JSON when it is ready and ends on SIGTERM, SIGINT or when its parent dies.
"""

import argparse
import os
import signal
import sys
import threading

import msgspec

from drivers.addresses import check_free, check_host
from drivers.errors import GraspError
from drivers.ur.emulator.controller import PROFILES, EmulatorSettings
from drivers.ur.emulator.server import PORTS, SWITCH_S, UrEmulator


def main() -> None:
    parser = argparse.ArgumentParser(description="Emulated UR10 controller.", allow_abbrev=False)
    parser.add_argument("--host", required=True, help="loopback address, 127.0.0.2 or later")
    parser.add_argument("--profile", choices=sorted(PROFILES), default="cb3")
    parser.add_argument("--fault-port", type=int, default=0, help="control channel; 0: any port")
    parser.add_argument("--unlock-delay", type=float, default=5.0, help="s after a protective stop")
    options = parser.parse_args()
    if not 0 <= options.fault_port <= 65535:
        sys.exit(f"error: --fault-port {options.fault_port}: allowed are 0 to 65535")
    settings = EmulatorSettings(
        host=options.host,
        profile=options.profile,
        fault_port=options.fault_port,
        unlock_delay_s=options.unlock_delay,
    )
    try:
        check_host(settings.host, beyond_loopback=False)
        check_free(settings.host, (*PORTS, settings.fault_port))
    except GraspError as error:
        sys.exit(f"error: {'; '.join(error.args)}")
    _serve(settings)


def _serve(settings: EmulatorSettings) -> None:
    sys.setswitchinterval(SWITCH_S)
    parent = os.getppid()
    asked_to_end = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: asked_to_end.set())
    with UrEmulator(settings) as emulator:
        ready = {"ready": True, "host": settings.host, "fault_port": emulator.fault_port}
        sys.stdout.write(msgspec.json.encode(ready).decode() + "\n")
        sys.stdout.flush()
        emulator.run(lambda: asked_to_end.is_set() or os.getppid() != parent)


if __name__ == "__main__":
    main()
