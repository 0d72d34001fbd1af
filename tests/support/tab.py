"""A page's connection to the server of a review, without a browser."""

from __future__ import annotations

import json
import time

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect


class Tab:
    """A page's connection."""

    def __init__(self, served, token=None, origin="own"):
        own = f"http://127.0.0.1:{served.port}"
        token = served.token if token is None else token
        where = f"ws://127.0.0.1:{served.port}/steps?token={token}"
        self._connection = connect(where, origin=own if origin == "own" else origin)
        self.version = 0

    def __enter__(self):
        self.page = self._connection.__enter__()
        return self

    def __exit__(self, *error):
        self._connection.__exit__(*error)

    def heard(self, *names, seconds=60):
        """The next message of one of these kinds."""
        end = time.monotonic() + seconds
        while True:
            message = json.loads(self.page.recv(timeout=max(end - time.monotonic(), 0.01)))
            if {*names} & message.keys():
                self.version = message.get("version", self.version)
                self.digest = message.get("state", {}).get("digest")
                return message

    def send(self, **message):
        self.page.send(json.dumps({"version": self.version, **message}))

    def approve(self, by="A. Planner", **wish):
        """Approve the state that is shown, but for what is given."""
        while self.digest is None:
            self.heard("state")
        self.send(approve={"by": by, "version": self.version, "digest": self.digest, **wish})

    def approvable(self):
        """Look along the line as somebody, until the plan may be approved."""
        self.send(name="A. Planner")
        self.send(step={"do": "viewed"})
        while not self.heard("state")["state"]["approvable"]:
            pass

    def leave(self, served):
        """Leave the review; what was written, and the codes of the errors that the tab heard."""
        written, codes, message = [], [], {}
        self.send(leave=True)
        end = time.monotonic() + 60
        served.run(lambda fixture: written.append(fixture) or "", lambda: time.monotonic() > end)
        while not {"left", "approved"} & message.keys():
            message = json.loads(self.page.recv(timeout=60))
            codes += [message["error"]["code"]] if "error" in message else []
        return written, codes

    def ends_by(self, *texts):
        """The code by which the connection ends once these texts were sent."""
        try:
            for text in texts:
                self.page.send(text)
            self.heard("never")
        except ConnectionClosed as closed:
            return closed.rcvd.code
