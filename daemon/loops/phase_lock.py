"""Where in its period a tick should lie: just after telemetry usually comes, so that the state is young when used."""

from cmath import phase, rect
from math import log, pi, sqrt

from daemon.frames import clamp
from daemon.latest import Latest
from daemon.loops.grid import MAX_SLEW, Grid
from daemon.messages import Odometry
from daemon.pipeline import Inputs, Record

MARGIN_S = 0.0002  # after the arrival: a thread of its own puts the sample into its cell
_SMOOTHING = 0.1  # share of a new sample
_REGULAR = 0.75  # length of the mean phasor from which on there is a phase to lock to
_SPREADS = 1.0  # standard deviations of the arrivals by which a tick comes later still
_GAIN = 0.3 * _SMOOTHING  # of the error, a tick: well damped together with the averaging
_PATIENCE = 0.08  # of a period, for a sample that is late; from a tenth on a tick counts as late
_LOOK_AGAIN_S = 0.0001
_DRIFT_GAIN = 0.25 * _GAIN * _GAIN  # the same of the drift between the clocks
_NEAR = 0.05  # of a period: what counts towards the drift, so that finding the phase is not taken for one


class PhaseLock:
    """A listener of the control task that slews its grid by the age of each new sample at its tick.

    Ages are averaged as phasors of the period, so that they may wrap. A stream that keeps no phase with the grid, for
    it is uneven or has another rate, gives no slew. While there is a phase, a tick also waits a little for a sample
    that is later than usual: without it the tick would use one that is a whole period older.
    """

    def __init__(self, grid: Grid, odometry: Latest[Odometry | None]) -> None:
        self._grid = grid
        self._odometry = odometry
        self._period_s = grid.period_s
        self._seen: Odometry | None = None
        self._mean = 0j
        self._drift_s = 0.0
        self._waits = False
        self._fresh = False
        grid.pause_s = self._pause_s

    def on_tick(self, inputs: Inputs, record: Record) -> None:
        """Look at the sample of this tick when it is a new one."""
        odometry = inputs.odometry
        before, self._fresh, self._waits = self._fresh, odometry is not None and odometry is not self._seen, False
        if odometry is not None and self._fresh:
            self._seen = odometry
            self._grid.slew_s = self.slew_s(record.now_s - odometry.arrival_s)
            # Not after a tick that waited in vain, nor where every other tick has nothing new: it would be in vain.
            self._waits = before and abs(self._mean) > _REGULAR

    def _pause_s(self, late_s: float) -> float:
        if not self._waits or late_s >= _PATIENCE * self._period_s or self._odometry.value is not self._seen:
            return 0.0
        return _LOOK_AGAIN_S

    def slew_s(self, age_s: float) -> float:
        """By how much the next tick should come later (earlier when negative)."""
        turns = 2.0 * pi / self._period_s
        self._mean += _SMOOTHING * (rect(1.0, turns * age_s) - self._mean)
        length = abs(self._mean)
        if not length > _REGULAR:
            self._drift_s = 0.0
            return 0.0
        spread_s = sqrt(-2.0 * log(min(1.0, length))) / turns
        wanted_s = MARGIN_S + _SPREADS * spread_s
        late_s = phase(self._mean * rect(1.0, -turns * wanted_s)) / turns
        drift_max_s = MAX_SLEW * self._period_s
        near_s = clamp(late_s, -_NEAR * self._period_s, _NEAR * self._period_s)
        self._drift_s = clamp(self._drift_s - _DRIFT_GAIN * near_s, -drift_max_s, drift_max_s)
        return self._drift_s - _GAIN * late_s
