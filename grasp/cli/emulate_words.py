"""What is typed into `grasp emulate`: what a person does to an object in a laboratory, and more."""

import json
import os
import signal
import stat
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import msgspec

from drivers.errors import ConfigError
from grasp.cli.view import turned_text
from scenarios.rigs.cell_faults import all_in_words
from scenarios.rigs.emulated_cell import EmulatedCell
from scenarios.tap.config import TapConfig
from scenarios.tap.mallet import Swing, swing

DIRECTIONS = ("top", "side", "closing")
KNOWN = (
    f"place | take | home | look | scale | tap [{'|'.join(DIRECTIONS)}] | "
    "press FINGER TAXEL [NEWTONS] | lay FINGER NEWTONS | fault NAME [SETTING=VALUE ...] | "
    "fault help"
)
STDIN = 0
POLL_S = 0.05
PRESS_S = 1.0  # of a pad


class Words:
    """Obeys lines of standard input, where that is a terminal or a pipe, until it ends."""

    def __init__(self, config: TapConfig, seed: int) -> None:
        """``config`` says how hard the mallet strikes; that is searched here, where nobody waits
        for a device's reply."""
        self._heard = _is_typed()
        self._blows: dict[str, Swing | ConfigError] = {}
        if not self._heard:
            return
        for direction in DIRECTIONS:
            tap = msgspec.structs.replace(config.tap, direction=direction)
            try:
                self._blows[direction] = swing(msgspec.structs.replace(config, tap=tap), seed)
            except ConfigError as none_found:  # what falls anyway is tapped by nobody
                self._blows[direction] = none_found

    def listen(self, cell: EmulatedCell) -> None:
        """Begin to obey; returns at once."""
        if not self._heard:
            return
        # sent to the background: reading from the terminal fails then, instead of stopping us
        signal.signal(signal.SIGTTIN, signal.SIG_IGN)
        if os.isatty(STDIN):
            _say(f"what a person does, a line each: {KNOWN}")
        threading.Thread(target=self._obey_all, args=(cell,), name="words", daemon=True).start()

    def _obey_all(self, cell: EmulatedCell) -> None:
        for line in _lines():
            if line.strip():
                _say(self._obey(cell, line.split()))

    def _obey(self, cell: EmulatedCell, words: list[str]) -> str:
        if words in (["fault"], ["fault", "help"]):
            return f"faults:\n{all_in_words()}"
        try:
            reply = cell.obey(self._request(words))
        except (ValueError, KeyError, msgspec.MsgspecError) as error:
            return f"{error.args[0] if error.args else error}: {KNOWN}"
        while words[0] == "home" and (reply.get("away_m") or reply.get("turned_rad")):
            time.sleep(POLL_S)
            reply = cell.obey({"verb": "home"})
        if "error" in reply:
            return str(reply["error"])
        if words[0] == "press":
            time.sleep(PRESS_S)  # done is who has let go
        if words[0] == "scale":
            return scale(reply["truth"])
        if words[0] == "fault" and "told" in reply:
            return f"done: {reply['told']}"
        return look(reply["truth"]) if words[0] == "look" else "done"

    def _request(self, words: list[str]) -> dict[str, Any]:
        verb, *rest = words
        if verb == "fault" and rest:
            pairs = (word.partition("=") for word in rest[1:])
            return {"verb": verb, "name": rest[0], **{k: _value(text) for k, _, text in pairs}}
        if verb == "tap" and rest[:1] in ([], *([name] for name in DIRECTIONS)) and not rest[1:]:
            found = self._blows[rest[0] if rest else "top"]
            if isinstance(found, ConfigError):
                raise ValueError(str(found))
            return {"verb": verb, **msgspec.to_builtins(found.blow)}
        if verb == "press" and len(rest) in (2, 3):
            finger, taxel, *newtons = rest
            force = {"newtons": _value(newtons[0])} if newtons else {}
            return {"verb": verb, "finger": finger.upper(), "taxel": _value(taxel), **force,
                    "seconds": PRESS_S}  # fmt: skip
        if verb == "lay" and len(rest) == 2:
            return {"verb": verb, "finger": rest[0].upper(), "newtons": _value(rest[1])}
        if verb in ("look", "scale") and not rest:
            return {"verb": "truth"}
        if verb in ("place", "take", "home") and not rest:
            return {"verb": verb}
        raise ValueError(f"{' '.join(words)!r} is not known")


def scale(truth: dict[str, Any]) -> str:
    """What scales under the fingertips would say."""
    fingers = zip("ABC", truth["normal_n"], strict=True)
    return "pressed with " + ", ".join(f"{name} {newtons:.2f} N" for name, newtons in fingers)


def look(truth: dict[str, Any]) -> str:
    """What a person sees of an object."""
    held = "held" if max(truth["normal_n"]) > 0 else "not touched"
    moved_mm = 1e3 * (truth["slip_distance_m"] ** 2 + truth["across_m"] ** 2) ** 0.5
    return f"the object is {held}, {truth['height_m'] * 1e3:.0f} mm above the table, " + ", ".join(
        t for t in (f"{moved_mm:.1f} mm from its mark", turned_text(truth["turn_rad"])) if t
    )


def _value(text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError:
        return text


def _is_typed() -> bool:
    """Whether somebody may type: not for standard input from nowhere, or a terminal in front of
    which another program runs."""
    try:
        mode = os.fstat(STDIN).st_mode
        if not os.isatty(STDIN):
            return stat.S_ISFIFO(mode)
        return os.tcgetpgrp(STDIN) == os.getpgrp()
    except OSError:  # closed
        return False


def _lines() -> Iterator[str]:
    """As they come. Not through sys.stdin, whose lock a thread that waits would hold at the end."""
    typed = b""
    with suppress(OSError):
        while some := os.read(STDIN, 4096):
            *lines, typed = (typed + some).split(b"\n")
            for line in lines:
                yield line.decode(errors="replace")


def _say(text: str) -> None:
    with suppress(OSError):
        print(f"cell: {text}", file=sys.stderr, flush=True)
