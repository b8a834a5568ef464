"""What every contestant shares: the numbers that travel through it, and its figures on standard output at the end.

``python -m daemon.bench.contestants.NAME PORT SECONDS WARM_UP``: a process in which nothing of the daemon runs.
"""

import json
import resource
import sys
import time

from daemon.bench.memory import peak_mb

PORT, SECONDS, WARM_UP_S = int(sys.argv[1]), float(sys.argv[2]), float(sys.argv[3])
PERIOD_S = 0.01


def thrust_of(x_m: float) -> float:
    """The thrust that tells which ODOMETRY was used: its number is in x, in micrometres."""
    return 0.3 + 1e-4 * round(x_m * 1e6)


class Meter:
    """CPU and memory over the time that counts."""

    def __init__(self) -> None:
        self.from_s = time.monotonic()
        self._cpu_s = _cpu_s()

    def done(self, others_cpu_s: float = 0.0, others_mb: float = 0.0) -> None:
        """Print the figures as JSON; ``others_*`` is what processes of ours took besides this one."""
        to_s = time.monotonic()
        figures = {
            "from_s": self.from_s,
            "to_s": to_s,
            "cpu_s": _cpu_s() - self._cpu_s + others_cpu_s,
            "rss_mb": peak_mb() + others_mb,
        }
        sys.stdout.write("\n" + json.dumps(figures) + "\n")
        sys.stdout.flush()


def _cpu_s() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime
