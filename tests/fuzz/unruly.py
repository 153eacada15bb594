"""A child of the fuzzer whose cases end as their targets are named: to try the watching itself."""

from __future__ import annotations

import os
import time
from multiprocessing.connection import Connection
from pathlib import Path

from scripts.fuzz import Result


def work(pipe: Connection, folder: Path) -> None:
    """Run cases as `scripts.fuzz.work` runs real ones."""
    os.setsid()
    pipe.send("ready")
    while True:
        name, _ = pipe.recv()
        (folder / "case").mkdir(exist_ok=True)
        (folder / "said.txt").write_text(name)
        if name == "crash":
            os.abort()
        if name == "time":
            time.sleep(60)
        pipe.send(Result("accepted", "", 0.0))
