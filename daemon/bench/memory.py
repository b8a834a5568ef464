"""The memory of a process, from /proc: ``ru_maxrss`` is that of the parent until the process has grown past it."""

import os
from pathlib import Path


def now_mb() -> float:
    """Resident memory of this process."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def peak_mb(pid: int | str = "self") -> float:
    """The most that was ever resident of a process; ``OSError`` when it is gone, 0 of one without memory."""
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmHWM:"):
            return int(line.split()[1]) / 1024.0
    return 0.0
