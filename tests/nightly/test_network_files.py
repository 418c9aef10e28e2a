"""Network files that are damaged at random, and a fresh process that loads one."""

import os
import random
import subprocess
import sys
from pathlib import Path

import pytest

from detector.network import run_network
from detector.network_file import Mode, read_network
from drivers.errors import BadFile
from tests.unit.detector.networks import walk, write_network

pytestmark = pytest.mark.slow


def test_to_load_a_network_leaves_nothing_in_home_cache_or_temporary_folder(
    tmp_path: Path,
) -> None:
    path = write_network(tmp_path, "tcn", "stream")
    places = {name: tmp_path / name for name in ("HOME", "XDG_CACHE_HOME", "TMPDIR")}
    for place in places.values():
        place.mkdir()
    silent = {"CI", "ORT_DISABLE_TELEMETRY", "ORT_RUNNING_UNIT_TESTS"}  # without us as well
    kept = {name: value for name, value in os.environ.items() if name not in silent}
    code = (
        "import sys; from pathlib import Path; from detector.network_file import read_network; "
        "read_network(Path(sys.argv[1]))"
    )
    subprocess.run(
        [sys.executable, "-c", code, str(path)], check=True,
        env=kept | {name: str(place) for name, place in places.items()},
    )  # fmt: skip
    assert [file for place in places.values() for file in place.rglob("*")] == []


def harmed(content: bytes, rng: random.Random) -> bytes:
    """Some bits, a run of bytes, a part left out, put in, or exchanged, or a broken card."""
    data = bytearray(content)
    at, size = rng.randrange(len(data)), rng.choice((1, 8, 200))
    kind = rng.choice(("bits", "bytes", "left out", "put in", "cut", "card", "card", "ends"))
    if kind == "bits":
        for _ in range(rng.choice((1, 4, 40))):
            data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    elif kind == "bytes":
        data[at : at + size] = rng.randbytes(size)
    elif kind == "left out":
        del data[at : at + size]
    elif kind == "put in":
        data[at:at] = rng.randbytes(size)
    elif kind == "cut":
        del data[at:]
    elif kind == "card":
        card = data.rfind(b'{"format"')
        at = rng.randrange(card, len(data))
        data[at] = rng.choice((0xFF, 0xC3, 0x00, 0x0A, 0x1B, rng.randrange(256)))
    else:  # names and shapes of what goes in and out stand beside the card
        for _ in range(3):
            data[rng.randrange(len(data) - 3_000, len(data))] = rng.randrange(256)
    return bytes(data)


@pytest.mark.parametrize(
    ("name", "mode", "seed"), [("tcn", "stream", 1), ("gru", "stream", 2), ("tcn", "window", 3)]
)
def test_every_damaged_file_is_one_line_or_a_network_that_runs(
    name: str, mode: Mode, seed: int, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = write_network(tmp_path, name, mode)
    content, rng = path.read_bytes(), random.Random(seed)
    refused = 0
    for _ in range(50):
        path.write_bytes(harmed(content, rng))
        try:
            detector = run_network(read_network(path), 3)
        except BadFile as error:
            refused += 1
            assert error.message.startswith(str(path)) and error.message.isprintable()
            continue
        p = detector.update(walk(2)[0])
        assert p.shape == (3,)
    assert refused > 12
    assert capfd.readouterr() == ("", "")
