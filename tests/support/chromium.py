"""Drive a headless Chromium through its debugging pipe; nothing to install but the browser."""

from __future__ import annotations

import json
import os
import subprocess
import time
from itertools import count

FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking",
    "--disable-component-update", "--disable-default-apps", "--disable-extensions",
    "--disable-sync", "--no-first-run", "--no-default-browser-check", "--hide-scrollbars",
    "--window-size=1100,900", "--remote-debugging-pipe",
)  # fmt: skip


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
        target = next(
            t for t in self._call("Target.getTargets")["targetInfos"] if t["type"] == "page"
        )
        arguments = {"targetId": target["targetId"], "flatten": True}
        self._session = self._call("Target.attachToTarget", **arguments)["sessionId"]
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

    def _until(self, ready, seconds=30):
        end = time.monotonic() + seconds
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
