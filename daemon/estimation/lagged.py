"""Measurements that come late: go back to the state before them, take them in, replay what came after.

A history entry is a measurement with the filter's state after it; states are immutable, so going back is a look-up.
Each replayed prediction uses the control term that was known when it was made first.
"""

from dataclasses import replace
from math import isfinite

from daemon.estimation.filter_base import Correction, FilterParameters, FilterState, Measurement, process
from daemon.estimation.filter_control import Control
from daemon.values import value


@value
class Entry:
    """A measurement and the state after it."""

    measurement: Measurement
    state: FilterState


@value
class LaggedState:
    """The filter's newest state and the entries behind it, oldest first."""

    state: FilterState
    history: tuple[Entry, ...] = ()


def take(
    lagged: LaggedState, measurement: Measurement, parameters: FilterParameters, history_s: float
) -> tuple[LaggedState, tuple[Correction, ...]]:
    """Take a measurement at the place in time where it belongs.

    Corrections: its own first, then those of the replayed ones. One that is older than the history of ``history_s`` is
    refused as too_old; its state is left as it was.
    """
    newest = lagged.state
    if not newest.initialized or not measurement.stamp_s < newest.stamp_s or not isfinite(measurement.stamp_s):
        state, record = process(newest, measurement, parameters)
        if not state.initialized or record.refused == "stamp":
            return lagged, (record,)
        history = _trimmed((*lagged.history, Entry(measurement, state)), history_s)
        return LaggedState(state, history), (record,)
    kept = [entry for entry in lagged.history if entry.state.stamp_s <= measurement.stamp_s]
    if not kept:
        return lagged, (Correction(measurement.source, measurement.stamp_s, "too_old"),)
    later = lagged.history[len(kept) :]
    control = later[0].state.control if later else newest.control
    queue = [(measurement, control), *((entry.measurement, entry.state.control) for entry in later)]
    return _replayed(kept, queue, parameters, newest)


def _replayed(
    kept: list[Entry],
    queue: list[tuple[Measurement, Control | None]],
    parameters: FilterParameters,
    newest: FilterState,
) -> tuple[LaggedState, tuple[Correction, ...]]:
    entries, records = list(kept), []
    state = kept[-1].state
    for measurement, control in queue:
        state, record = process(replace(state, control=control), measurement, parameters)
        entries.append(Entry(measurement, state))
        records.append(record)
    return LaggedState(replace(state, control=newest.control), tuple(entries)), tuple(records)


def _trimmed(history: tuple[Entry, ...], history_s: float) -> tuple[Entry, ...]:
    oldest_s = history[-1].state.stamp_s - history_s
    first = 0
    while history[first].state.stamp_s < oldest_s:
        first += 1
    return history[first:]
