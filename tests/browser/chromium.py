"""Headless Chromium, controlled over two pipes with the DevTools protocol, without a driver.

https://chromedevtools.github.io/devtools-protocol/, messages end with a zero byte.
"""

import base64
import json
import os
import shutil
import subprocess
from pathlib import Path
from types import TracebackType
from typing import Any, Self

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
BROWSER = next(filter(None, map(shutil.which, NAMES)), None)
TO_BROWSER, FROM_BROWSER = 3, 4  # descriptors that --remote-debugging-pipe uses
KEYS = {" ": "Space", "n": "KeyN", "p": "KeyP"}


class Chromium:
    """One page in one browser; collects its requests and error messages.

    with Chromium(folder) as page: page.open(file); page.value("1 + 1")
    """

    def __init__(
        self, profile: Path, dark: bool = False, size: tuple[int, int] = (1280, 900)
    ) -> None:
        assert BROWSER is not None
        self.requests: list[str] = []
        self.errors: list[str] = []
        self._number = 0
        self._received = b""
        self._session: str | None = None
        command = [
            BROWSER, "--headless=new", "--remote-debugging-pipe", "--no-sandbox", "--disable-gpu",
            "--no-first-run", "--disable-background-networking", "--disable-extensions",
            "--disable-component-update", "--disable-sync", "--hide-scrollbars",
            "--force-color-profile=srgb", "--disable-dev-shm-usage",
            f"--window-size={size[0]},{size[1]}", f"--user-data-dir={profile}", "about:blank",
        ]  # fmt: skip
        read, self._to = os.pipe()
        self._from, write = os.pipe()
        # the shell moves the two ends to the descriptors that the browser uses
        moved = f'exec "$@" {TO_BROWSER}<&{read} {FROM_BROWSER}>&{write}'
        self._process = subprocess.Popen(
            ["bash", "-c", moved, "bash", *command], pass_fds=(read, write),
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        os.close(read)
        os.close(write)
        self._size = size
        self._attach(dark)

    def _attach(self, dark: bool) -> None:
        targets = self.call("Target.getTargets")["targetInfos"]
        page = next(target for target in targets if target["type"] == "page")
        attached = self.call("Target.attachToTarget", targetId=page["targetId"], flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.call(f"{domain}.enable")
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[scheme])

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        at: TracebackType | None,
    ) -> None:
        self._session = None
        if kind is None:
            self.call("Browser.close")
        else:
            self._process.kill()
        os.close(self._to)
        os.close(self._from)
        self._process.wait(timeout=20)

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send one command and return its result."""
        self._number += 1
        message: dict[str, Any] = {"id": self._number, "method": method, "params": parameters}
        if self._session is not None:
            message["sessionId"] = self._session
        os.write(self._to, json.dumps(message).encode() + b"\0")
        while True:
            reply = self._next()
            if reply.get("id") == self._number:
                assert "error" not in reply, f"{method}: {reply['error']}"
                result: dict[str, Any] = reply["result"]
                return result
            self._note(reply)

    def _next(self) -> dict[str, Any]:
        while b"\0" not in self._received:
            more = os.read(self._from, 1 << 20)
            assert more, "the browser has ended"
            self._received += more
        text, _, self._received = self._received.partition(b"\0")
        message: dict[str, Any] = json.loads(text)
        return message

    def _note(self, event: dict[str, Any]) -> None:
        parameters = event.get("params", {})
        match event.get("method"):
            case "Network.requestWillBeSent":
                self.requests.append(parameters["request"]["url"])
            case "Runtime.exceptionThrown":
                details = parameters["exceptionDetails"]
                self.errors.append(details.get("exception", {}).get("description", str(details)))
            case "Log.entryAdded":
                self.errors.append(parameters["entry"]["text"])
            case "Runtime.consoleAPICalled":
                self.errors.append(str(parameters["args"]))

    def resize(self, width: int, height: int) -> None:
        self.call(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1,
            mobile=False,
        )  # fmt: skip

    def open(self, page: Path) -> None:
        """Load a file and wait until its scripts, if any, report that they are ready."""
        self.call("Page.navigate", url=page.as_uri())
        waiting = f"""new Promise((done) => {{ const look = () =>
            location.href === {json.dumps(page.as_uri())} && document.readyState === "complete" &&
            (document.documentElement.dataset.ready || !document.scripts.length)
            ? done(true) : setTimeout(look, 20);
            look(); setTimeout(() => done(false), 20000); }})"""
        assert self.value(waiting), f"{page} was never ready: {self.errors}"

    def value(self, expression: str) -> Any:
        """Value of a JavaScript expression; waits for a promise."""
        reply = self.call(
            "Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True
        )
        assert "exceptionDetails" not in reply, reply["exceptionDetails"]
        return reply["result"].get("value")

    def text(self, selector: str) -> str:
        return str(self.value(f"document.querySelector({json.dumps(selector)}).textContent"))

    def press(self, key: str, shift: bool = False) -> None:
        """Press and release a key."""
        event = {"key": key, "code": KEYS.get(key, key), "modifiers": 8 if shift else 0}
        text = {"text": key} if len(key) == 1 else {}
        self.call("Input.dispatchKeyEvent", type="keyDown", **event, **text)
        self.call("Input.dispatchKeyEvent", type="keyUp", **event)

    def click(self, x: float, y: float) -> None:
        self.drag(x, y, x, y)

    def drag(self, x: float, y: float, to_x: float, to_y: float) -> None:
        """Press the left button at one place and release it at another."""
        places = [("Moved", x, y), ("Pressed", x, y), ("Moved", to_x, to_y)]
        for kind, at_x, at_y in [*places, ("Released", to_x, to_y)]:
            button = {"button": "left", "buttons": 1, "clickCount": 1}
            self.call("Input.dispatchMouseEvent", type=f"mouse{kind}", x=at_x, y=at_y, **button)

    def printed(self) -> bytes:
        """The page as PDF."""
        return base64.b64decode(self.call("Page.printToPDF", printBackground=True)["data"])
