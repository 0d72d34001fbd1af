"""What a Dask scheduler costs a task, with as many workers as a large cluster has.

    python docs/make_scheduler.py [WORKERS=1000] [TASKS=20000]

The scheduler and the calling process are Dask's own, each in a process; the workers are simulated
in a third: they register, beat, take what is scattered, and report every task as done at once.
Printed is processor time, which the others on the machine do not change.
"""

from __future__ import annotations

import asyncio
import logging
import os
import subprocess
import sys
import tempfile
import time
from typing import Any

from distributed import Client, as_completed
from distributed.batched import BatchedSend
from distributed.core import Server, Status
from distributed.protocol import to_serialize
from distributed.protocol.pickle import dumps
from distributed.worker import get_versions

VERSIONS = get_versions()
METRICS: dict[str, Any] = {
    "bandwidth": {"total": 1e8, "workers": {}, "types": {}},
    "digests_total_since_heartbeat": {}, "memory": 10**8, "cpu": 100.0,
    "spilled_bytes": {"memory": 0, "disk": 0}, "managed_bytes": 0, "task_counts": {},
}  # fmt: skip


class Idle(Server):
    """A worker of one thread for which every task is nothing."""

    def __init__(self, scheduler: str, number: int) -> None:
        self.scheduler_address, self.number = scheduler, number
        self.stream = BatchedSend(interval="2ms")
        ignored = dict.fromkeys(
            ("free-keys", "remove-replicas", "acquire-replicas", "refresh-who-has",
             "cancel-compute", "worker-status-change"), lambda **_: None)  # fmt: skip
        super().__init__(
            handlers={"update_data": self._update, "gather": self._gather, "get_data": self._give},
            stream_handlers={
                **ignored,
                "compute-task": self._compute,
                "steal-request": self._stolen,
            },
        )

    async def _update(self, data: dict) -> dict:
        return {"nbytes": dict.fromkeys(data, 10**5), "status": "OK"}

    async def _gather(self, who_has: dict) -> dict:
        return {"status": "OK"}

    async def _give(self, comm: Any, keys: list, who: Any = None, **_: Any) -> Status:
        await comm.write({"status": "OK", "data": {key: to_serialize(0) for key in keys}})
        await comm.read()
        return Status.dont_reply

    def _compute(self, key: Any, run_id: int, stimulus_id: str, **_: Any) -> None:
        now = time.time()
        self.stream.send({
            "op": "task-finished", "status": "OK", "key": key, "run_id": run_id, "nbytes": 28,
            "type": dumps(int), "typename": "int", "metadata": {}, "thread": 1,
            "startstops": [{"action": "compute", "start": now, "stop": now}],
            "stimulus_id": stimulus_id,
        })  # fmt: skip

    def _stolen(self, key: Any, stimulus_id: str) -> None:
        self.stream.send({"op": "steal-response", "key": key, "state": "memory",
                          "stimulus_id": stimulus_id})  # fmt: skip

    async def start_unsafe(self) -> Idle:
        """Register with the scheduler."""
        await super().start_unsafe()
        await self.listen("tcp://127.0.0.1:0")
        comm = await self.rpc.connect(self.scheduler_address)
        await comm.write({
            "op": "register-worker", "reply": False, "address": self.address, "status": "running",
            "nthreads": 1, "name": self.number, "now": time.time(), "resources": {},
            "memory_limit": 2**32, "local_directory": "", "services": {}, "nanny": None,
            "pid": os.getpid(), "versions": VERSIONS, "metrics": METRICS, "extra": {},
            "stimulus_id": "begin", "server_id": self.id,
        })  # fmt: skip
        beat = (await comm.read())["heartbeat-interval"]
        self.stream.start(comm)
        self.living = [asyncio.create_task(self.handle_stream(comm)),
                       asyncio.create_task(self._beat(max(5.0, beat)))]  # fmt: skip
        return self

    async def _beat(self, every: float) -> None:
        while True:
            await asyncio.sleep(every)
            await self.rpc(self.scheduler_address).heartbeat_worker(
                address=self.address, now=time.time(), metrics=METRICS, executing={}
            )


async def serve(scheduler: str, count: int) -> None:
    """Be that many workers until killed."""
    logging.getLogger("distributed").setLevel(logging.WARNING)
    for number in range(count):
        await Idle(scheduler, number)
    await asyncio.Event().wait()


def seconds(pid: int) -> float:
    """Processor time of a process so far [s]."""
    with open(f"/proc/{pid}/stat") as file:
        fields = file.read().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def nothing(held: bytes, block: int) -> int:
    """What is said to be done."""
    return 0


def measure(workers: int, tasks: int) -> None:
    """Print what these tasks cost."""
    with tempfile.TemporaryDirectory() as folder:
        place = os.path.join(folder, "s.json")
        words = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--no-dashboard",
                 "--host", "127.0.0.1", "--port", "0", "--scheduler-file", place]  # fmt: skip
        boss = subprocess.Popen(words, stderr=subprocess.DEVNULL)
        while not os.path.exists(place):
            time.sleep(0.1)
        with Client(scheduler_file=place, timeout="60s") as client:
            address = client.scheduler.address
            idle = subprocess.Popen([sys.executable, __file__, "--serve", address, str(workers)])
            try:
                client.wait_for_workers(workers)
                began = seconds(boss.pid), seconds(os.getpid())
                held = client.scatter(bytes(10**5), broadcast=True, hash=False)
                spread = seconds(boss.pid)
                futures = [client.submit(nothing, held, k, pure=False, retries=4)
                           for k in range(tasks)]  # fmt: skip
                count = sum(1 for _ in as_completed(futures, with_results=True))
                ended = seconds(boss.pid), seconds(os.getpid())
            finally:
                idle.kill()
                boss.kill()
    print(f"{workers} workers, {count} tasks: scheduler {1e3 * (ended[0] - spread) / count:.2f} ms "
          f"a task, caller {1e3 * (ended[1] - began[1]) / count:.2f} ms; "
          f"sending 100 kB to all {spread - began[0]:.1f} s of the scheduler")  # fmt: skip


if __name__ == "__main__":
    if sys.argv[1:2] == ["--serve"]:
        asyncio.run(serve(sys.argv[2], int(sys.argv[3])))
    else:
        measure(*map(int, sys.argv[1:3]), *(1000, 20_000)[len(sys.argv) - 1 :])
