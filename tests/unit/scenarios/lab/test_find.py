"""Addresses are asked one by one; nothing is searched for."""

import pytest

from drivers.errors import UsageError
from grasp.cli.main import main
from scenarios.lab.find import ask


@pytest.mark.parametrize(
    "word", ["10.0.0.0/24", "10.0.0.1:x", "http://10.0.0.1", "tcp://10.0.0.1", "", "a:b:c"]
)
def test_what_is_no_address_of_one_device_is_refused(word: str) -> None:
    with pytest.raises(UsageError, match=r"address|[Pp]ort"):
        list(ask([word], 0.1))


def test_nobody_at_an_address_is_told_for_each_port(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor", "127.0.0.99", "tcp://127.0.0.99:9", "--timeout", "0.2"]) == 3
    shown = capsys.readouterr()
    assert [line.split()[0] for line in shown.out.splitlines()] == ["no"] * 5
    assert "nobody answers" in shown.err
