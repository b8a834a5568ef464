"""Real-time rights where they are permitted, and a plain warning where they are not; nothing is loaded in flight."""

import ctypes
import importlib
import os
import sys
import threading

from daemon import logs
from daemon.settings import Loops

_MCL_CURRENT_AND_FUTURE = 3
_SWITCH_S = 0.0005  # how long the loop waits for a thread that computes (a planner, the record); Python's own: 5 ms

_LOADED_LATE = ("pymap3d",)  # `frames` has it at the first place on the globe: thirty files of a slow disk, some ticks

log = logs.get("realtime")


def preload() -> None:
    """Load the modules that others load at their first use."""
    for name in _LOADED_LATE:
        importlib.import_module(name)


def apply(loops: Loops) -> dict[str, str]:
    """CPU affinity, SCHED_FIFO and locked memory as configured, for the threads there are; later ones inherit them.

    For all of them: one that is not scheduled while it holds the interpreter lock would stop the loop.
    Returns what was refused: a warning for people by its code.
    """
    sys.setswitchinterval(_SWITCH_S)
    refused: dict[str, str] = {}
    threads = [thread.native_id or 0 for thread in threading.enumerate()]
    if loops.cpu_affinity:
        try:
            for thread in threads:
                os.sched_setaffinity(thread, loops.cpu_affinity)
        except OSError as error:
            cores = ", ".join(map(str, loops.cpu_affinity))
            refused["cpu_affinity_refused"] = f"loops.cpu_affinity {cores} was refused: {error.strerror}"
    if loops.realtime_priority:
        try:
            for thread in threads:
                os.sched_setscheduler(thread, os.SCHED_FIFO, os.sched_param(loops.realtime_priority))
        except OSError as error:
            text = f"loops.realtime_priority was refused: {error.strerror}; grant CAP_SYS_NICE or LimitRTPRIO"
            refused["realtime_refused"] = text
    if loops.lock_memory:
        libc = ctypes.CDLL(None, use_errno=True)
        if libc.mlockall(_MCL_CURRENT_AND_FUTURE) != 0:
            reason = os.strerror(ctypes.get_errno())
            text = f"loops.lock_memory was refused: {reason}; grant CAP_IPC_LOCK or LimitMEMLOCK"
            refused["lock_memory_refused"] = text
    for code, text in refused.items():
        log.warning(code, text=text)
    return refused
