"""The arithmetic of the loop's benchmark: what the client said and what the autopilot's end saw, as figures."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from statistics import linear_regression, median
from typing import Any

from daemon.bench.quantiles import quantile
from daemon.bench.stillness import Span, still_s, within
from daemon.sim.metronome import NUMBERS

Figures = dict[str, Any]

OVERTAKEN_S = 1e-3
_OWN = frozenset({"from_s", "to_s", "cpu_s", "rss_mb", "used", "memory"})
PARTS = ("wire to callback", "callback to tick", "tick to wire")
_STILL = ("still_ms", "missing_own", "overtaken_own")
_COUNTS = frozenset(
    {"setpoints", "missing", "overtaken", "late", "missed", "missed_collecting", "collections", "rounds", *_STILL}
)


@dataclass(slots=True)
class Delays:
    """Seconds from ODOMETRY on the wire to setpoints on the wire, both by the clock of the autopilot's end.

    ``every``: to each setpoint from the sample that it was computed from, so a sample that was used again counts again.
    ``first``: from each sample that was used to the first setpoint that used it. ``overtaken``: of the setpoints before
    which a newer sample had been sent by ``OVERTAKEN_S`` or more, when that was and when they left. ``parts``: each of
    ``first`` as ``PARTS``, of the daemon.
    """

    every: list[float] = field(default_factory=list)
    first: list[float] = field(default_factory=list)
    overtaken: list[Span] = field(default_factory=list)
    parts: list[tuple[float, float, float]] = field(default_factory=list)


def figures_of(said: Figures, log: Figures, period_s: float, still: Sequence[Span] | None = None) -> Figures:
    """Milliseconds, per cent of a core and megabytes, over the time that the client counted.

    ``missing``: setpoints that did not come between two that did, or before the end. ``still``: when a core of the
    client's stood still, if that was watched: ``missing_own`` and ``overtaken_own`` are what is left without that time.
    """
    from_s, to_s = said["from_s"], said["to_s"]
    setpoints = [(at_s, thrust) for at_s, thrust in log["setpoints"] if from_s <= at_s <= to_s]
    gaps = [after - before for (before, _), (after, _) in pairwise(setpoints)]
    times = [from_s, *(at_s for at_s, _ in setpoints), to_s]
    deviations = [abs(gap - period_s) for gap in gaps]
    delays = delays_of(setpoints, said.get("used"), log["odometry"])
    figures = {
        "rounds": 1,
        "seconds": to_s - from_s,
        "setpoints": len(setpoints),
        "period_p50_ms": 1e3 * quantile(gaps, 0.5),
        "period_p99_ms": 1e3 * quantile(gaps, 0.99),
        "period_max_ms": 1e3 * max(gaps, default=0.0),
        "deviation_p50_ms": 1e3 * quantile(deviations, 0.5),
        "deviation_p99_ms": 1e3 * quantile(deviations, 0.99),
        "delay_p50_ms": 1e3 * quantile(delays.every, 0.5),
        "delay_p99_ms": 1e3 * quantile(delays.every, 0.99),
        "first_p50_ms": 1e3 * quantile(delays.first, 0.5),
        "first_p99_ms": 1e3 * quantile(delays.first, 0.99),
        "missing": sum(_missing(before, after, period_s) for before, after in pairwise(times)),
        "overtaken": len(delays.overtaken),
        "cpu_pct": 100.0 * said["cpu_s"] / (to_s - from_s),
        "cpu_s_per_minute": 60.0 * said["cpu_s"] / (to_s - from_s),
        "rss_mb": said["rss_mb"],
    }
    if still is not None:
        spans = within(still, from_s, to_s)
        figures |= {
            "still_ms": 1e3 * still_s(spans, from_s, to_s),
            "still_max_ms": 1e3 * max((ended_s - begun_s for begun_s, ended_s in spans), default=0.0),
            "missing_own": sum(_missing(before, after, period_s, spans) for before, after in pairwise(times)),
            "overtaken_own": sum(
                left_s - sent_s - still_s(spans, sent_s, left_s) >= OVERTAKEN_S for sent_s, left_s in delays.overtaken
            ),
        }
    if delays.parts:
        figures["parts"] = {
            f"{part} p{100 * share:.0f}_ms": 1e3 * quantile(seconds, share)
            for part, seconds in zip(PARTS, zip(*delays.parts, strict=True), strict=True)
            for share in (0.5, 0.99)
        }
    if "memory" in said:
        figures |= _memory(said["memory"])
    return figures | {key: value for key, value in said.items() if key not in _OWN}


def _missing(before_s: float, after_s: float, period_s: float, still: Sequence[Span] = ()) -> int:
    """How many setpoints did not come between two that did; one that is merely late is not missing.

    ``still`` explains it when less than one and a half periods are left without: little stillness, little excuse.
    """
    missing = max(0, int((after_s - before_s) / period_s + 0.1) - 1)
    ran_s = after_s - before_s - still_s(still, before_s, after_s)
    return min(missing, max(0, round(ran_s / period_s) - 1))


def _memory(samples: Sequence[tuple[float, float]]) -> Figures:
    """Of samples (seconds, megabytes): the first, the last, and the slope of the line of least squares."""
    times_s, megabytes = zip(*samples, strict=True)
    return {
        "rss_first_mb": megabytes[0],
        "rss_last_mb": megabytes[-1],
        "rss_slope_mb_h": 3600.0 * linear_regression(times_s, megabytes).slope,
    }


def delays_of(
    setpoints: Sequence[tuple[float, float]],
    used: Sequence[tuple[float, int, float]] | None,
    odometry: Sequence[tuple[int, float]],
) -> Delays:
    """The delays of setpoints (arrival, thrust) on samples (number, when it was sent).

    The daemon says what it ``used``: time of the tick, number, arrival by its clock; the others send it as thrust.
    """
    found, tick, newest, last = Delays(), 0, 0, -1
    for at_s, thrust in setpoints:
        number = round((thrust - 0.3) * 1e4) % NUMBERS
        if used is not None:
            while tick + 1 < len(used) and used[tick + 1][0] <= at_s:
                tick += 1
            number = used[tick][1] % NUMBERS
        while newest + 1 < len(odometry) and odometry[newest + 1][1] <= at_s:
            newest += 1
        own = newest
        while own > 0 and odometry[own][0] != number and newest - own < NUMBERS:
            own -= 1
        if odometry[own][0] != number:
            continue
        delay_s = at_s - odometry[own][1]
        found.every.append(delay_s)
        if own > last:
            found.first.append(delay_s)
            if used is not None:
                tick_s, _, arrival_s = used[tick]
                found.parts.append((arrival_s - odometry[own][1], tick_s - arrival_s, at_s - tick_s))
            last = own
        if own < newest and odometry[own + 1][1] <= at_s - OVERTAKEN_S:
            found.overtaken.append((odometry[own + 1][1], at_s))
    return found


def over_rounds(rounds: Sequence[Figures]) -> Figures:
    """One flight's figures over its rounds: medians, but sums of counts and the largest of ``*_max_ms``.

    What not every round has is left out, and so are rounds that failed: ``failed`` counts them, ``failure`` says why;
    the first one's figures when all did.
    """
    good = [figures for figures in rounds if "error" not in figures]
    if not good:
        return rounds[0]
    common = [key for key in good[0] if all(key in figures for figures in good)]
    merged: Figures = {key: _merged(key, [figures[key] for figures in good]) for key in common}
    failures = [figures["error"] for figures in rounds if "error" in figures]
    return merged | ({"failed": len(failures), "failure": failures[0]} if failures else {})


def _merged(key: str, values: list[Any]) -> Any:
    if isinstance(values[0], dict):
        return {k: _merged(key, [value[k] for value in values]) for k in values[0]}
    if key in _COUNTS:
        return sum(values)
    return max(values) if key.endswith("_max_ms") else median(values)
