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
IGNORED_MESSAGES = [
    "free-keys",
    "remove-replicas",
    "acquire-replicas",
    "refresh-who-has",
    "cancel-compute",
    "worker-status-change",
]
"""Messages of a scheduler that a worker without work need not answer."""


def worker_metrics() -> dict[str, Any]:
    """What an idle worker reports of itself."""
    return {
        "bandwidth": {"total": 1e8, "workers": {}, "types": {}},
        "digests_total_since_heartbeat": {},
        "memory": 10**8,
        "cpu": 100.0,
        "spilled_bytes": {"memory": 0, "disk": 0},
        "managed_bytes": 0,
        "task_counts": {},
    }


class IdleWorker(Server):
    """A worker of one thread that reports every task as done at once."""

    def __init__(self, scheduler: str, number: int) -> None:
        self.scheduler_address = scheduler
        self.number = number
        self.stream = BatchedSend(interval="2ms")
        handlers = {
            "update_data": self.update_data,
            "gather": self.gather,
            "get_data": self.get_data,
        }
        stream_handlers = dict.fromkeys(IGNORED_MESSAGES, lambda **_: None)
        stream_handlers["compute-task"] = self.finish_task
        stream_handlers["steal-request"] = self.refuse_to_give
        super().__init__(handlers=handlers, stream_handlers=stream_handlers)

    async def update_data(self, data: dict) -> dict:
        """Take data that are scattered."""
        return {"nbytes": dict.fromkeys(data, 10**5), "status": "OK"}

    async def gather(self, who_has: dict) -> dict:
        """Take data from other workers."""
        return {"status": "OK"}

    async def get_data(self, comm: Any, keys: list, who: Any = None, **_: Any) -> Status:
        """Hand over results."""
        await comm.write({"status": "OK", "data": dict.fromkeys(keys, to_serialize(0))})
        await comm.read()
        return Status.dont_reply

    def finish_task(self, key: Any, run_id: int, stimulus_id: str, **_: Any) -> None:
        """Report a task as done."""
        now = time.time()
        self.stream.send(
            {
                "op": "task-finished",
                "status": "OK",
                "key": key,
                "run_id": run_id,
                "nbytes": 28,
                "type": dumps(int),
                "typename": "int",
                "metadata": {},
                "thread": 1,
                "startstops": [{"action": "compute", "start": now, "stop": now}],
                "stimulus_id": stimulus_id,
            }
        )

    def refuse_to_give(self, key: Any, stimulus_id: str) -> None:
        """Answer that a task cannot be stolen, because it is done."""
        self.stream.send(
            {"op": "steal-response", "key": key, "state": "memory", "stimulus_id": stimulus_id}
        )

    async def start_unsafe(self) -> IdleWorker:
        """Register with the scheduler."""
        await super().start_unsafe()
        await self.listen("tcp://127.0.0.1:0")
        comm = await self.rpc.connect(self.scheduler_address)
        await comm.write(
            {
                "op": "register-worker",
                "reply": False,
                "address": self.address,
                "status": "running",
                "nthreads": 1,
                "name": self.number,
                "now": time.time(),
                "resources": {},
                "memory_limit": 2**32,
                "local_directory": "",
                "services": {},
                "nanny": None,
                "pid": os.getpid(),
                "versions": VERSIONS,
                "metrics": worker_metrics(),
                "extra": {},
                "stimulus_id": "begin",
                "server_id": self.id,
            }
        )
        interval_s = (await comm.read())["heartbeat-interval"]
        self.stream.start(comm)
        self.tasks = [
            asyncio.create_task(self.handle_stream(comm)),
            asyncio.create_task(self.send_heartbeats(max(5.0, interval_s))),
        ]
        return self

    async def send_heartbeats(self, interval_s: float) -> None:
        """Tell the scheduler again and again that this worker lives."""
        while True:
            await asyncio.sleep(interval_s)
            await self.rpc(self.scheduler_address).heartbeat_worker(
                address=self.address, now=time.time(), metrics=worker_metrics(), executing={}
            )


async def serve(scheduler: str, count: int) -> None:
    """Be that many workers until killed."""
    logging.getLogger("distributed").setLevel(logging.WARNING)
    for number in range(count):
        await IdleWorker(scheduler, number)
    await asyncio.Event().wait()


def seconds(pid: int) -> float:
    """Processor time of a process so far [s]."""
    with open(f"/proc/{pid}/stat") as file:
        fields = file.read().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def no_work(data: bytes, block: int) -> int:
    """The task that is reported as done."""
    return 0


def measure(workers: int, tasks: int) -> None:
    """Print what these tasks cost."""
    with tempfile.TemporaryDirectory() as folder:
        address_file = os.path.join(folder, "s.json")
        command = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--no-dashboard"]
        command += ["--host", "127.0.0.1", "--port", "0", "--scheduler-file", address_file]
        scheduler = subprocess.Popen(command, stderr=subprocess.DEVNULL)
        while not os.path.exists(address_file):
            time.sleep(0.1)
        with Client(scheduler_file=address_file, timeout="60s") as client:
            address = client.scheduler.address
            idle = subprocess.Popen([sys.executable, __file__, "--serve", address, str(workers)])
            try:
                client.wait_for_workers(workers)
                scheduler_start_s = seconds(scheduler.pid)
                caller_start_s = seconds(os.getpid())
                data = client.scatter(bytes(10**5), broadcast=True, hash=False)
                scattered_s = seconds(scheduler.pid)
                futures = []
                for k in range(tasks):
                    futures.append(client.submit(no_work, data, k, pure=False, retries=4))
                count = sum(1 for _ in as_completed(futures, with_results=True))
                scheduler_end_s = seconds(scheduler.pid)
                caller_end_s = seconds(os.getpid())
            finally:
                idle.kill()
                scheduler.kill()
    scheduler_ms = 1e3 * (scheduler_end_s - scattered_s) / count
    caller_ms = 1e3 * (caller_end_s - caller_start_s) / count
    print(
        f"{workers} workers, {count} tasks: scheduler {scheduler_ms:.2f} ms a task, "
        f"caller {caller_ms:.2f} ms; sending 100 kB to all "
        f"{scattered_s - scheduler_start_s:.1f} s of the scheduler"
    )


def main(words: list[str]) -> None:
    """Serve workers, or measure what tasks cost."""
    if words[:1] == ["--serve"]:
        asyncio.run(serve(words[1], int(words[2])))
        return
    workers = 1000
    tasks = 20_000
    if len(words) > 0:
        workers = int(words[0])
    if len(words) > 1:
        tasks = int(words[1])
    measure(workers, tasks)


if __name__ == "__main__":
    main(sys.argv[1:])
