"""The loop's figures as a table, and beside figures of before as ratios to the clients of the same run."""

from collections.abc import Iterable
from typing import Any

from daemon.bench.loop_figures import PARTS, Figures

_COLUMNS = (
    ("period", "p50", "period_p50_ms", 2),
    ("deviation", "p50", "deviation_p50_ms", 2),
    ("", "p99", "deviation_p99_ms", 2),
    ("delay", "p50", "delay_p50_ms", 2),
    ("", "p99", "delay_p99_ms", 2),
    ("first use", "p50", "first_p50_ms", 2),
    ("", "p99", "first_p99_ms", 2),
    ("overtaken", "", "overtaken", 0),
    ("CPU %", "", "cpu_pct", 1),
    ("MB", "", "rss_mb", 0),
)
_LEGEND = """\
Milliseconds at the autopilot's socket. deviation: of the setpoints' period from its nominal value. delay: from ODOMETRY
on the wire to each setpoint that used it; first use: to the first one. overtaken: setpoints that left 1 ms or more
after a newer sample. CPU: of one core, all processes of the client; only flightd computes, the others echo, at a phase
to the stream that is chance, so that their delays compare with nothing."""
_RATIOS = (
    ("deviation p99 / synchronous plugin", "flightd", "deviation_p99_ms", "synchronous plugin", "0.7"),
    ("deviation p99 / C, SCHED_FIFO", "flightd", "deviation_p99_ms", "C, SCHED_FIFO", ""),
    ("CPU, recording / asyncio API", "flightd, recording", "cpu_pct", "asyncio API", "1.0"),
    ("CPU, recording, real time / asyncio API", "flightd, recording, real time", "cpu_pct", "asyncio API", "1.0"),
    ("the same / asyncio API on one core", "flightd, recording, real time", "cpu_pct", "asyncio API, one core", ""),
    ("CPU, recording / mavsdk-grpc", "flightd, recording", "cpu_pct", "mavsdk-grpc", "1.0"),
)
_LONG_S = 60.0  # from which on a slope of memory means something


def table(figures: dict[str, Figures]) -> str:
    """One line a flight, what its figures mean, then what only the daemon knows of itself."""
    width = max(len(name) for name in figures) + 1
    lines = [
        _row("", width, (f"{group:>10}" for group, _, _, _ in _COLUMNS)),
        _row("", width, (f"{title:>10}" for _, title, _, _ in _COLUMNS)),
    ]
    for name, of_flight in figures.items():
        if "error" in of_flight:
            lines.append(f"{name.ljust(width)}  {of_flight['error']}")
        else:
            lines.append(_row(name, width, (f"{of_flight[key]:>10.{n}f}" for _, _, key, n in _COLUMNS)))
    lines.append("")
    lines.append(_LEGEND)
    for name, of_flight in figures.items():
        lines.extend(_remarks(name, of_flight))
    return "\n".join(lines)


def _row(name: str, width: int, cells: Iterable[str]) -> str:
    return (name.ljust(width) + "".join(cells)).rstrip()


def _remarks(name: str, f: Figures) -> list[str]:
    """What the table has no column for."""
    lines = _inside(f) if "stages_us" in f else []
    if "error" not in f and (lost := _lost(f)):
        lines.append(lost)
    if f.get("fifo") == 0:
        lines.append("SCHED_FIFO was refused")
    if f.get("failed"):
        lines.append(f"{f['failed']} more rounds failed: {f['failure']}")
    return ["", f"{name}:", *(f"  {line}" for line in lines)] if lines else []


def _lost(f: Figures) -> str:
    """What was missing or overtaken, and what a core that stood still explains of it; empty when there is nothing."""
    text = f"setpoints missing: {f['missing']}, overtaken: {f['overtaken']}"
    if f.get("still_ms"):
        own = f"without that {f['missing_own']} and {f['overtaken_own']}"
        return (
            f"{text}; a core stood still for {f['still_ms']:.0f} ms, at most {f['still_max_ms']:.0f} in one go: {own}"
        )
    if not f["missing"] and not f["overtaken"]:
        return ""
    return text if "still_ms" in f else f"{text}; it could not be watched whether a core stood still"


def _inside(f: Figures) -> list[str]:
    stages = ", ".join(f"{stage} {cost:.0f}" for stage, cost in f["stages_us"].items())
    parts = ", ".join(
        f"{part} {f['parts'][f'{part} p50_ms']:.2f} / {f['parts'][f'{part} p99_ms']:.2f}" for part in PARTS
    )
    collections = ", ".join(f"{count} of {generation}" for generation, count in f["collections"].items())
    slope = f", {f['rss_slope_mb_h']:+.2f} MB an hour" if f["seconds"] >= _LONG_S else ""
    return [
        f"period p99 {f['period_p99_ms']:.2f}, max {f['period_max_ms']:.2f} ms; {f['setpoints']} setpoints,"
        f" ticks late {f['late']}, missed {f['missed']}, of these after a collection {f['missed_collecting']}",
        f"first use in parts, p50 / p99 ms: {parts}",
        f"step p50 {f['step_p50_us']:.0f}, p99 {f['step_p99_us']:.0f} us; run again in one go, p50: {stages}",
        f"collections {collections}; longest {f['collection_max_ms']:.2f} ms",
        f"memory {f['rss_first_mb']:.2f} to {f['rss_last_mb']:.2f} MB{slope};"
        f" {f['cpu_s_per_minute']:.1f} CPU s a flown minute",
    ]


def ratios(figures: dict[str, Figures]) -> dict[str, float]:
    """The daemon's figures over those of a client in the same run."""
    found = {}
    for title, flight, key, client, _ in _RATIOS:
        ours, theirs = figures.get(flight, {}).get(key), figures.get(client, {}).get(key)
        if ours is not None and theirs:
            found[title] = ours / theirs
    return found


def compared(now: dict[str, Figures], before: dict[str, Any] | None) -> str:
    """The ratios of now, what is wanted of them, and those of committed figures where there are some."""
    new, old = ratios(now), ratios(before["flights"]) if before else {}
    width = max(len(title) for title, *_ in _RATIOS) + 1
    lines = [f"{'ratio in this run':<{width}}{'now':>8}{'at most':>10}{'committed':>12}"]
    for title, _, _, _, wanted in _RATIOS:
        if title in new:
            committed = f"{old[title]:.2f}" if title in old else "-"
            lines.append(f"{title:<{width}}{new[title]:>8.2f}{wanted or '-':>10}{committed:>12}")
    return "\n".join(lines) if len(lines) > 1 else ""
