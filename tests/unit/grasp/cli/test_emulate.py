"""Where `grasp emulate` may listen: refused in one line, before anything is opened."""

import pytest

from drivers.errors import UsageError
from grasp.cli.emulate import _check_host


@pytest.mark.parametrize("host", ["0.0.0.0", "192.168.0.1", "localhost", "foo", ""])
def test_an_address_beyond_loopback_has_to_be_asked_for(host) -> None:
    with pytest.raises(UsageError, match="is no loopback address"):
        _check_host(host, False)


@pytest.mark.parametrize("host", ["localhost", "foo"])
def test_beyond_loopback_takes_an_address_and_no_name(host) -> None:
    with pytest.raises(UsageError, match="is no address"):
        _check_host(host, True)


def test_beyond_loopback_needs_an_address_and_none_is_ours_alone() -> None:
    with pytest.raises(UsageError, match="needs --host"):
        _check_host(None, True)
    with pytest.raises(UsageError, match="ur_rtde skips a check there"):
        _check_host("127.0.0.1", True)
    _check_host("0.0.0.0", True)
    _check_host("127.0.0.2", False)
    _check_host(None, False)
