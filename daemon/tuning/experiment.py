"""The flight that measures: engage, hold, pulse, hand back; ended at once when something is not as it should be."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from math import degrees, dist, radians

from daemon.config import with_value
from daemon.frames import down_axis, tilt_of
from daemon.loops.turns import NotPossibleError
from daemon.loops.vehicle import Vehicle
from daemon.messages import EstimatedState
from daemon.pipeline import Inputs, Record
from daemon.safety.supervision import Drive
from daemon.safety.supervisor import FLYING, State
from daemon.settings import Config
from daemon.tuning.pulsed import PulsedAutopilot, Sent
from daemon.tuning.pulses import Programme

DEPARTURE_MAX_M = 2.0
TILT_MAX_RAD = radians(20.0)
CONNECT_S = 30.0
LOCATE_S = 60.0
SETTLE_S = 5.0
_PERMIT_S = 0.03  # three ticks: then the pulses end without anybody's doing
_POLL_S = 0.05


class StoppedError(Exception):
    """The pulses were ended before they were through; the text says why."""


@dataclass(frozen=True, slots=True)
class Sample:
    """One sample of ODOMETRY: when it was true (loop clock), how old it was on arrival, and what it says."""

    state: EstimatedState
    age_s: float

    @property
    def upright(self) -> float:
        """Cosine of the tilt."""
        return down_axis(self.state.attitude_wb)[2]


@dataclass(frozen=True, slots=True)
class Recording:
    """What was sent and what was measured while the programme ran, from ``begun_s`` of the loop's clock on."""

    begun_s: float
    programme: Programme
    sent: list[Sent]
    samples: list[Sample]


class Guard:
    """A listener of the control task: takes samples, and permits the pulses tick by tick while all is well."""

    def __init__(self, pulsed: PulsedAutopilot) -> None:
        self.samples: list[Sample] = []
        self.watching = False
        self.objection: str | None = None
        self._pulsed = pulsed
        self._newest: EstimatedState | None = None

    def on_tick(self, inputs: Inputs, record: Record) -> None:
        """See ``ControlTask.listeners``."""
        newest = record.estimate.newest
        if newest is not None and newest is not self._newest and inputs.odometry is not None:
            self._newest = newest
            self.samples.append(Sample(newest, inputs.odometry.arrival_s - newest.time_s))
        if not self.watching:
            return
        self.objection = _objection(record)
        if self.objection is not None:
            self.watching = False
            self._pulsed.permit(float("-inf"))
        elif record.drive is Drive.LAW:
            self._pulsed.permit(record.now_s + _PERMIT_S)


def _objection(record: Record) -> str | None:
    """What speaks against another pulse."""
    if record.supervision.state is not State.HOLDING:
        return f"the supervisor went to {record.supervision.state.value} ({record.supervision.reason})"
    newest, reference = record.estimate.newest, record.reference
    if newest is None or reference is None:
        return "there is no estimate"
    departure_m = dist(newest.position_ned_m, reference.position_ned_m)
    if not departure_m <= DEPARTURE_MAX_M:
        return f"the vehicle is {departure_m:.1f} m off; {DEPARTURE_MAX_M:g} m are allowed"
    tilt_rad = tilt_of(newest.attitude_wb)
    if not tilt_rad <= TILT_MAX_RAD:
        return f"the vehicle tilts by {degrees(tilt_rad):.0f} deg; {degrees(TILT_MAX_RAD):.0f} deg are allowed"
    return None


def gentle(config: Config) -> Config:
    """The configuration with which pulses are flown: loops half as fast, so that they hardly answer the pulses.

    The autopilot's own estimate is flown: what it measures is fitted, not what a filter makes of it.
    """
    control = config.control
    slowed = {
        "position_gain_1_s2": [0.25 * gain for gain in control.position_gain_1_s2],
        "velocity_gain_1_s": [0.5 * gain for gain in control.velocity_gain_1_s],
        "attitude_time_constant_s": [2.0 * constant for constant in control.attitude_time_constant_s],
        "disturbance_bandwidth_rad_s": 0.5 * control.disturbance_bandwidth_rad_s,
    }
    for key, value in slowed.items():
        config = with_value(config, f"control.{key}", value)
    config = with_value(config, "estimator.external_pose", "off")
    return with_value(config, "estimator.kind", "autopilot")


async def fly(
    vehicle: Vehicle,
    pulsed: PulsedAutopilot,
    programme: Programme,
    *,
    takeoff_m: float | None,
    tell: Callable[[str], None] = lambda _text: None,
) -> Recording:
    """Fly the programme with a vehicle whose tasks run; it is handed back to Hold, and landed if it was taken off.

    ``takeoff_m``: height to take off to when it stands on the ground; None refuses that. Raises ``StoppedError``,
    ``NotPossibleError`` and ``LinkError``.
    """
    commander = vehicle.commander
    grounded = await _airborne(vehicle, takeoff_m, tell)
    guard = Guard(pulsed)
    vehicle.control.listeners.append(guard.on_tick)
    try:
        await commander.engage()
        tell("settling")
        await asyncio.sleep(SETTLE_S)
        recording = await _pulse(pulsed, guard, programme, tell)
        await commander.hold()
    finally:
        guard.watching = False
        pulsed.permit(float("-inf"))
        vehicle.control.listeners.remove(guard.on_tick)
        if commander.state in FLYING:
            await vehicle.release()
    if grounded:
        tell("landing")
        await commander.land()
    return recording


async def _airborne(vehicle: Vehicle, takeoff_m: float | None, tell: Callable[[str], None]) -> bool:
    """Wait for the vehicle, and take off if it is on the ground and may; whether it was."""
    commander = vehicle.commander
    tell("waiting for the autopilot")
    ready = (State.STANDBY, State.READY, State.PILOT)
    await commander.wait_for(lambda: commander.state in ready and _estimated(vehicle), CONNECT_S, "connected")
    if commander.state is not State.STANDBY:
        return False
    if takeoff_m is None:
        raise NotPossibleError("the vehicle is on the ground: fly it to Hold first, or let it with --takeoff")
    tell(f"taking off to {takeoff_m:g} m")
    status = vehicle.autopilot.status
    await commander.wait_for(lambda: status.value.global_position is not None, LOCATE_S, "located")
    await commander.takeoff(takeoff_m)
    return True


async def _pulse(pulsed: PulsedAutopilot, guard: Guard, programme: Programme, tell: Callable[[str], None]) -> Recording:
    loop = asyncio.get_running_loop()
    guard.samples.clear()
    begun_s = pulsed.begin(programme)
    guard.watching = True
    for axis in dict.fromkeys(pulse.axis for pulse in programme):
        tell(f"pulses on {axis.value}")
        until_s = begun_s + max(pulse.end_s for pulse in programme if pulse.axis is axis)
        while loop.time() < until_s:
            if guard.objection is not None:
                raise StoppedError(f"stopped at the pulses on {axis.value}: {guard.objection}")
            await asyncio.sleep(_POLL_S)
    guard.watching = False
    return Recording(begun_s, programme, pulsed.sent, list(guard.samples))


def _estimated(vehicle: Vehicle) -> bool:
    record = vehicle.record.value
    return record is not None and record.estimate.newest is not None
