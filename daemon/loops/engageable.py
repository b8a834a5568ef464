"""What hinders an engage, in words: the vehicle's state, and a mode that was asked for and may still come."""

from daemon.messages import (
    AutopilotStatus,
    BatteryCharge,
    ClockSync,
    FlightMode,
    LandedState,
    RequestKind,
    SystemStatus,
    VehicleRequest,
)
from daemon.pipeline import Record

NOT_HEARD = "nothing shows what the autopilot does now"


def not_flown(status: AutopilotStatus) -> str:
    """Why this kind of vehicle is not flown at all; empty for a multirotor."""
    return (
        f"flightd flies multirotors, and the autopilot says that this is {status.airframe}" if status.airframe else ""
    )


def hindrances(
    status: AutopilotStatus,
    record: Record,
    request: VehicleRequest | None,
    clock: ClockSync | None,
    *,
    patience_s: float,
) -> list[str]:
    """``request`` is the newest, read or not; ``patience_s`` after it was asked for, a mode does not come any more.

    ``clock``: what TIMESYNC says, which alone sees how long the link takes.
    """
    round_trip_s = 0.0 if clock is None else clock.round_trip_s
    coming = _coming(status, record, request, patience_s)
    return [
        text
        for fails, text in (
            (status.airframe != "", not_flown(status)),
            (coming is not None, f"{coming} was asked for and may still come"),
            (not status.heard, NOT_HEARD),
            (not status.armed, "the vehicle is not armed"),
            (status.landed is not LandedState.IN_AIR, f"landed state is {status.landed.name.lower()}"),
            (status.mode is not FlightMode.HOLD, f"the mode is {status.mode.value}, not hold"),
            (
                status.intended_mode not in (status.mode, FlightMode.UNKNOWN),
                f"the autopilot intends {status.intended_mode.value}: a failsafe acts",
            ),
            (
                status.system_status is not SystemStatus.ACTIVE,
                f"the autopilot's system status is {status.system_status.name.lower()}",
            ),
            (
                status.battery_charge >= BatteryCharge.CRITICAL,
                f"the autopilot calls the battery {status.battery_charge.name.lower()}",
            ),
            (
                record.conditions.link_slow,
                f"the link takes {round_trip_s:.2f} s there and back: too slow to fly by (link.round_trip_max_s)",
            ),
            (not record.conditions.state_usable, "there is no fresh estimate"),
            (record.conditions.estimate_poor, "the position estimate is too uncertain"),
            (record.conditions.estimate_worsens, "the position estimate is becoming uncertain"),
            (record.conditions.attitude_disagrees, "the autopilot's attitude and its accelerometer disagree"),
            (record.conditions.tilt_excess, "the vehicle is tilted too far"),
            (record.conditions.speed_excess, "the vehicle is too fast"),
            (record.conditions.fence_breached, "the vehicle is beyond the hard fence: it has to be flown back first"),
            (record.conditions.battery_low, "the battery is below safety.battery_min_pct"),
        )
        if fails
    ]


def _coming(status: AutopilotStatus, record: Record, request: VehicleRequest | None, patience_s: float) -> str | None:
    """The mode that is on its way: not yet read by the supervisor, or not yet shown or refused by the autopilot."""
    supervision, refusal = record.supervision, status.mode_refusal
    if request is not None and request.serial != supervision.serial and request.kind is not RequestKind.ENGAGE:
        return str(request.kind.value)
    mode, asked_s = supervision.asked_mode, supervision.asked_s
    if mode is None or mode is status.mode or record.now_s - asked_s > patience_s:
        return None
    refused = refusal is not None and refusal.mode is mode and refusal.time_s >= asked_s
    return None if refused else mode.value
