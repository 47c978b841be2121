"""Chromium without a screen, driven by its own protocol through two pipes: real clicks and fingers, and its complaints."""

import base64
import fcntl
import io
import itertools
import json
import os
import shutil
import subprocess
import time
from pathlib import Path
from typing import Any, Self

from PIL import Image
from portable import PATIENCE

CHROMIUM = next((found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), None)
FLAGS = (
    "--headless", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    "--disable-dev-shm-usage", "--remote-debugging-pipe", "about:blank",
)  # fmt: skip


class Browser:
    """A page in a window of so many pixels, of a phone with a touch screen where it is narrow; `errors` holds its complaints."""

    def __init__(self, page: Path, width: int, height: int, folder: Path):
        self.errors: list[str] = []
        self._events: list[str] = []
        self._numbers = itertools.count(1)
        self._session: dict[str, str] = {}
        # the browser reads from 3 and writes to 4: ours lie above both until then
        ends = [fcntl.fcntl(end, fcntl.F_DUPFD_CLOEXEC, 10) for end in (*os.pipe(), *os.pipe())]
        self._answers, self._commands = open(ends[2], "rb"), open(ends[1], "wb")
        self._process = subprocess.Popen(
            [str(CHROMIUM), f"--user-data-dir={folder}", *FLAGS], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            close_fds=False, preexec_fn=lambda: (os.dup2(ends[0], 3), os.dup2(ends[3], 4)) and None,
        )  # fmt: skip
        for end in (ends[0], ends[3]):
            os.close(end)
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = {"sessionId": self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]}
        for domain in ("Page", "Runtime", "Log"):
            self.call(f"{domain}.enable")
        phone = width < 700
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=phone)
        self.call("Emulation.setTouchEmulationEnabled", enabled=phone, maxTouchPoints=2)
        self.call("Page.navigate", url=page.as_uri())
        while "Page.loadEventFired" not in self._events:
            self._receive()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._session = {}
        self.call("Browser.close")
        self._process.wait(PATIENCE)
        self._answers.close()
        self._commands.close()

    def call(self, method: str, **words: Any) -> dict[str, Any]:
        """Call a method of the DevTools protocol; return its answer."""
        number = next(self._numbers)
        self._commands.write(json.dumps({"id": number, "method": method, "params": words} | self._session).encode() + b"\0")
        self._commands.flush()
        while (answer := self._receive()).get("id") != number:
            pass
        assert "error" not in answer, answer
        return answer["result"]

    def _receive(self) -> dict[str, Any]:
        letters = bytearray()
        while (letter := self._answers.read(1)) != b"\0":
            assert letter, f"the browser ended with {self._process.wait(PATIENCE)}"
            letters += letter
        message = json.loads(letters)
        method, words = message.get("method", ""), message.get("params", {})
        self._events.append(method)
        bad = words.get("type") in ("error", "assert") or words.get("entry", {}).get("level") == "error"
        if method == "Runtime.exceptionThrown" or (method in ("Runtime.consoleAPICalled", "Log.entryAdded") and bad):
            self.errors.append(letters.decode())
        return message

    def value(self, expression: str) -> Any:
        """The value of an expression in the page, after the next picture was drawn."""
        drawn = f"new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done({expression}))))"
        answer = self.call("Runtime.evaluate", expression=drawn, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def until(self, expression: str) -> None:
        """Wait until an expression is true."""
        end = time.monotonic() + PATIENCE
        while not self.value(expression):
            assert time.monotonic() < end, f"never: {expression}"

    def touch(self, kind: str, *points: tuple[float, float]) -> None:
        """Fingers: touchStart, touchMove or touchEnd at points of the window."""
        fingers = [{"x": x, "y": y, "id": number} for number, (x, y) in enumerate(points)]
        self.call("Input.dispatchTouchEvent", type=kind, touchPoints=fingers)

    def click(self, x: float, y: float) -> None:
        """A click of the mouse, or a tap of a finger."""
        if self.value("navigator.maxTouchPoints") > 0:
            self.touch("touchStart", (x, y))
            self.touch("touchEnd")
        else:
            for kind in ("mousePressed", "mouseReleased"):
                self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    def click_on(self, selector: str, across: float = 0.5) -> None:
        """A click on an element, at a fraction of its width."""
        self.click(*self.value(f"(r => [r.x + {across} * r.width, r.y + r.height / 2])({box(selector)})"))

    def picture(self) -> Image.Image:
        """What is on the screen."""
        return Image.open(io.BytesIO(base64.b64decode(self.call("Page.captureScreenshot")["data"]))).convert("RGB")


def box(selector: str) -> str:
    """The expression of an element's rectangle."""
    return f"document.querySelector('{selector}').getBoundingClientRect()"
