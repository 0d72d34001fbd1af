"""Pools: their processes end with the program, however that ends."""

import os
import subprocess
import sys
import time

import pytest

CODE = """
import os, time
from vfplan.io.sandbox import worker_processes
if __name__ == "__main__":
    with worker_processes(2) as pool:
        print(*{pool.submit(os.getpid).result() for _ in range(1)}, flush=True)
        time.sleep(300)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="the system's own means is Linux's")
def test_a_killed_program_leaves_no_worker(tmp_path):
    script = tmp_path / "pool.py"
    script.write_text(CODE)
    program = subprocess.Popen([sys.executable, script], stdout=subprocess.PIPE, text=True)
    worker = int(program.stdout.readline())
    os.kill(worker, 0)  # it is there
    program.kill()
    program.wait()
    for _ in range(600):
        if not alive(worker):
            break
        time.sleep(0.1)
    assert not alive(worker)


def alive(number):
    """Whether a process runs; one that ended and that nobody has asked about yet does not."""
    try:
        with open(f"/proc/{number}/stat") as file:
            return file.read().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False
