"""Checks of an emulator's address, before anything is opened or compiled."""

import errno
import socket
from collections.abc import Iterable
from ipaddress import IPv4Address, ip_address

from drivers.errors import LinkLost, UsageError

ANOTHER = "choose another loopback address, e.g. 127.0.0.2"


def check_host(host: str, beyond_loopback: bool) -> None:
    """Raises UsageError for an address that an emulator must not listen on."""
    if host == "127.0.0.1":
        raise UsageError("127.0.0.1 is not allowed: ur_rtde skips a check there", ANOTHER)
    what = "address" if beyond_loopback else "loopback address"
    others = f"{ANOTHER}; others with `grasp emulate --beyond-loopback`"
    try:
        address = ip_address(host)
    except ValueError:
        problem = f"{host!r} is no {what}" + (" but a name" if host else "")
        raise UsageError(problem, f"give the numeric address; {others}") from None
    if not isinstance(address, IPv4Address):
        raise UsageError(f"{host!r} is an IPv6 address; only IPv4 is supported", ANOTHER)
    if not (address.is_loopback or beyond_loopback):
        raise UsageError(f"{host!r} is no {what}", others)


def check_free(host: str, ports: Iterable[int]) -> None:
    """Raises LinkLost where one of these ports cannot be listened on; 0 is any port."""
    for port in ports:
        try:
            socket.create_server((host, port)).close()
        except OSError as error:
            raise cannot_listen(host, error) from None


_REMEDIES = {errno.EADDRNOTAVAIL: ANOTHER, errno.EACCES: "choose a port above 1023"}


def cannot_listen(host: str, error: OSError) -> LinkLost:
    remedy = _REMEDIES.get(error.errno or 0, "end the other cell, or choose another --host")
    return LinkLost(f"cannot listen on {host}: {error.strerror or error}", remedy)
