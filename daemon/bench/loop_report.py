"""The loop's figures as a table, and beside figures of before as ratios to the clients of the same run."""

from typing import Any

from daemon.bench.loop import Figures

_COLUMNS = (
    ("period ms", "period_p50_ms", 2),
    ("deviation p50", "deviation_p50_ms", 2),
    ("p99 ms", "deviation_p99_ms", 2),
    ("delay p50", "delay_p50_ms", 2),
    ("p99 ms", "delay_p99_ms", 2),
    ("overtaken %", "overtaken_pct", 1),
    ("CPU %", "cpu_pct", 1),
    ("memory MB", "rss_mb", 0),
)
_RATIOS = (
    ("deviation p99 / synchronous plugin", "deviation_p99_ms", "synchronous plugin"),
    ("delay p50 / synchronous plugin", "delay_p50_ms", "synchronous plugin"),
    ("CPU / asyncio API", "cpu_pct", "asyncio API"),
    ("CPU / mavsdk-grpc", "cpu_pct", "mavsdk-grpc"),
)
_OURS = "flightd"


def table(figures: dict[str, Figures]) -> str:
    """One line a flight, then what only the daemon knows of itself."""
    width = max(len(name) for name in figures)
    lines = ["".ljust(width) + "".join(f"{title:>15}" for title, _, _ in _COLUMNS)]
    for name, of_flight in figures.items():
        if "error" in of_flight:
            lines.append(f"{name.ljust(width)}  {of_flight['error']}")
            continue
        lines.append(name.ljust(width) + "".join(f"{of_flight[key]:>15.{n}f}" for _, key, n in _COLUMNS))
    for name, of_flight in figures.items():
        if "stages_us" in of_flight:
            lines.append(_inside(name, of_flight))
    return "\n".join(lines)


def _inside(name: str, f: Figures) -> str:
    stages = ", ".join(f"{stage} {cost:.0f}" for stage, cost in f["stages_us"].items())
    return (
        f"{name}: period p99 {f['period_p99_ms']:.2f} max {f['period_max_ms']:.2f} ms;"
        f" step p50 {f['step_p50_us']:.0f} p99 {f['step_p99_us']:.0f} us ({stages}); late {f['late']:.0f},"
        f" missed {f['missed']:.0f}; {f['collections']:.0f} collections of garbage, longest"
        f" {f['collection_max_ms']:.2f} ms; memory {f['rss_first_mb']:.1f} to {f['rss_last_mb']:.1f} MB;"
        f" {f['cpu_s_per_minute']:.1f} CPU s a flown minute"
    )


def ratios(figures: dict[str, Figures]) -> dict[str, float]:
    """The daemon's figures over those of a client in the same run."""
    found = {}
    for title, key, client in _RATIOS:
        ours, theirs = figures.get(_OURS, {}).get(key), figures.get(client, {}).get(key)
        if ours is not None and theirs:
            found[title] = ours / theirs
    return found


def compared(now: dict[str, Figures], before: dict[str, Any]) -> str:
    """The ratios of now beside those of the committed figures."""
    old = ratios(before["flights"])
    lines = [f"{'ratio':<38}{'now':>8}{'committed':>12}"]
    for title, ratio in ratios(now).items():
        lines.append(f"{title:<38}{ratio:>8.2f}{old[title]:>12.2f}" if title in old else f"{title:<38}{ratio:>8.2f}")
    return "\n".join(lines)
