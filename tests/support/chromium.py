"""Drive a headless Chromium through its debugging pipe; nothing to install but the browser."""

from __future__ import annotations

import base64
import json
import os
import subprocess
import time
from itertools import count
from pathlib import Path

FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking",
    "--disable-component-update", "--disable-default-apps", "--disable-extensions",
    "--disable-sync", "--no-first-run", "--no-default-browser-check", "--hide-scrollbars",
    "--window-size=1100,900", "--remote-debugging-pipe",
)  # fmt: skip


KEY_CODES = {
    "Enter": 13, "Escape": 27, " ": 32, "Tab": 9, "Delete": 46, "Backspace": 8,
    "ArrowLeft": 37, "ArrowUp": 38, "ArrowRight": 39, "ArrowDown": 40,
}  # fmt: skip
CTRL, SHIFT = 2, 8


class Page:
    """One page in a browser of its own; use as a context manager."""

    def __init__(self, program, profile):
        read, self._write = os.pipe()
        self._read, write = os.pipe()

        def place():  # the browser reads commands from 3 and writes answers to 4
            a, b = os.dup(read), os.dup(write)
            os.dup2(a, 3)
            os.dup2(b, 4)

        self._process = subprocess.Popen(
            [program, *FLAGS, f"--user-data-dir={profile}", "about:blank"],
            preexec_fn=place,
            pass_fds=(3, 4),
            close_fds=True,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(read)
        os.close(write)
        os.set_blocking(self._read, False)
        self._ids, self._rest, self.events = count(1), b"", []
        targets = self._call("Target.getTargets")["targetInfos"]
        target = next(t["targetId"] for t in targets if t["type"] == "page")
        attached = self._call("Target.attachToTarget", targetId=target, flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.do(f"{domain}.enable")

    def open(self, url):
        self.do("Page.navigate", url=url)
        self.loaded(1)

    def loaded(self, times):
        """Wait until a page has been loaded so often, by itself or by `open`."""
        fired = "Page.loadEventFired"
        self._until(lambda: sum(e["method"] == fired for e in self.events) >= times)

    def do(self, method, **parameters):
        return self._call(method, self._session, **parameters)

    def run(self, script):
        """The value of a JavaScript expression."""
        done = self.do("Runtime.evaluate", expression=script, returnByValue=True)
        assert "exceptionDetails" not in done, done["exceptionDetails"]
        return done["result"].get("value")

    # A hand: places are pixels of the window.

    def press(self, x, y, kind="mousePressed", button="left", clicks=1, modifiers=0):
        self.do("Input.dispatchMouseEvent", type=kind, x=x, y=y, button=button, clickCount=clicks,
                modifiers=modifiers)  # fmt: skip

    def press_at(self, x, y):
        """Move to a place and press there."""
        self.press(x, y, "mouseMoved", "none")
        self.press(x, y)

    def click(self, x, y):
        self.press_at(x, y)
        self.press(x, y, "mouseReleased")

    def drag(self, start, stop, steps=8, release=True):
        """Press at one place, move to another in steps, and let go there."""
        self.press_at(*start)
        for k in range(1, steps + 1):
            at = [a + (b - a) * k / steps for a, b in zip(start, stop, strict=True)]
            self.press(*at, "mouseMoved")
        if release:
            self.press(*stop, "mouseReleased")

    def wheel(self, x, y, turned, modifiers=0):
        """Turn the wheel over a place; `turned` below 0 is away from the hand."""
        self.do("Input.dispatchMouseEvent", type="mouseWheel", x=x, y=y, deltaX=0, deltaY=turned,
                modifiers=modifiers)  # fmt: skip

    def move_down(self, share):
        """Move over the view, down its middle from its top to a share of its height."""
        where = "(b => [b.left + b.width / 2, b.top, b.height])(view.getBoundingClientRect())"
        x, top, height = self.run(where)
        for k in range(1, 21):
            self.press(x, top + share * height * k / 20, "mouseMoved", "none")
            time.sleep(0.02)

    def key(self, key, modifiers=0):
        """Press and release a key by its name, such as "a", "Enter" or "ArrowLeft"."""
        text = {"text": key} if len(key) == 1 and not modifiers & 2 else {}
        text = {"text": "\r"} if key == "Enter" else text
        number = KEY_CODES.get(key, ord(key.upper()) if len(key) == 1 else 0)
        given = {"key": key, "modifiers": modifiers, "windowsVirtualKeyCode": number}
        self.do("Input.dispatchKeyEvent", type="keyDown", **given, **text)
        self.do("Input.dispatchKeyEvent", type="keyUp", **given)

    def type(self, text):
        self.do("Input.insertText", text=text)

    def size(self, width, height):
        self.do("Emulation.setDeviceMetricsOverride", width=width, height=height,
                deviceScaleFactor=1, mobile=False)  # fmt: skip

    def dark(self):
        feature = {"name": "prefers-color-scheme", "value": "dark"}
        self.do("Emulation.setEmulatedMedia", features=[feature])

    def picture(self, path):
        """Write what the window shows as a PNG."""
        data = self.do("Page.captureScreenshot", format="png")["data"]
        Path(path).write_bytes(base64.b64decode(data))

    def until(self, script, wanted=bool, seconds=30):
        """Run an expression until its value is as wanted; the value."""
        end = time.monotonic() + seconds
        while not wanted(found := self.run(script)):
            assert time.monotonic() < end, (script, found)
            time.sleep(0.02)
        return found

    def wrong(self):
        """The errors that the page's scripts threw or wrote."""
        return [e for e in self.events if e["method"] == "Runtime.exceptionThrown"]

    def _call(self, method, session=None, **parameters):
        message = {"id": next(self._ids), "method": method, "params": parameters}
        if session:
            message["sessionId"] = session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        found = []

        def answered():
            found.extend(a for a in self._answers if a["id"] == message["id"])
            return found

        self._answers = []
        self._until(answered)
        assert "error" not in found[0], found[0]
        return found[0]["result"]

    def _until(self, ready):
        end = time.monotonic() + 30
        while not ready():
            assert time.monotonic() < end, "the browser did not answer"
            try:
                data = os.read(self._read, 1 << 20)
            except BlockingIOError:
                time.sleep(0.01)
                continue
            *whole, self._rest = (self._rest + data).split(b"\0")
            for text in whole:
                message = json.loads(text)
                (self._answers if "id" in message else self.events).append(message)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._process.terminate()
        self._process.wait(10)
        os.close(self._read)
        os.close(self._write)
