"""Where `grasp emulate` may listen: refused in one line, before anything is opened."""

import os
import socket

import pytest

from drivers.addresses import check_host
from drivers.errors import LinkLost, UsageError
from grasp.cli.emulate import check_address

ADDRESS = f"127.{230 + os.getpid() % 20}.{os.getpid() // 20 % 250}.2"  # nobody else's here


@pytest.mark.parametrize("host", ["0.0.0.0", "192.168.0.1", "localhost", "foo", ""])
def test_an_address_beyond_loopback_has_to_be_asked_for(host) -> None:
    with pytest.raises(UsageError, match="is no loopback address"):
        check_address(host, False)


@pytest.mark.parametrize("host", ["localhost", "foo"])
def test_beyond_loopback_takes_an_address_and_no_name(host) -> None:
    with pytest.raises(UsageError, match="is no address but a name"):
        check_address(host, True)
    with pytest.raises(UsageError, match="is no loopback address but a name") as caught:
        check_address(host, False)
    assert caught.value.remedy.startswith("give the address itself; choose another loopback")
    assert "127.0.0.2" in caught.value.remedy


@pytest.mark.parametrize("beyond_loopback", [False, True])
@pytest.mark.parametrize("host", ["::1", "::", "fe80::1"])
def test_ipv6_is_refused_by_name(host, beyond_loopback) -> None:
    with pytest.raises(UsageError, match="is an IPv6 address"):
        check_address(host, beyond_loopback)


def test_a_port_that_is_taken_is_told_before_anything_is_compiled() -> None:
    with socket.create_server((ADDRESS, 0)) as other:
        port = other.getsockname()[1]
        with pytest.raises(LinkLost, match="in use") as caught:
            check_address(ADDRESS, False, port)
        assert "end the other cell" in caught.value.remedy
    check_address(ADDRESS, False, port)


def test_beyond_loopback_needs_an_address_and_none_is_ours_alone() -> None:
    with pytest.raises(UsageError, match="needs --host"):
        check_address(None, True)
    with pytest.raises(UsageError, match="ur_rtde skips a check there"):
        check_address("127.0.0.1", True)
    check_host("0.0.0.0", beyond_loopback=True)
    check_host("127.0.0.2", beyond_loopback=False)
    check_address(None, False)
