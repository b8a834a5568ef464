"""What the supervisor's table looks at: named yes/no facts with bounds and hysteresis; pure."""

from dataclasses import dataclass, field
from math import inf

from daemon.frames import add, norm, tilt_of
from daemon.messages import (
    ZERO3,
    AutopilotStatus,
    BatteryCharge,
    EstimatedState,
    FlightMode,
    LandedState,
    SystemStatus,
    Vec3,
)
from daemon.safety.geofence import Geofence, excess_m
from daemon.values import value

SINKING_M_S = 0.2  # PX4's velocity is off by this much at rest
LANDING_MODES = frozenset({FlightMode.LAND, FlightMode.RETURN, FlightMode.PRECISION_LAND})
# UNKNOWN is one of them: an autopilot newer than our table may have a pilot's mode that it lacks.
PILOT_MODES = frozenset(
    {
        FlightMode.MANUAL,
        FlightMode.ALTITUDE,
        FlightMode.ALTITUDE_CRUISE,
        FlightMode.POSITION,
        FlightMode.POSITION_SLOW,
        FlightMode.ACRO,
        FlightMode.STABILIZED,
        FlightMode.UNKNOWN,
    }
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Bounds:
    """Bounds of the conditions.

    A condition comes after its ``*_for_s`` without a break and goes below ``hysteresis`` times the bound.

    ``coast_s``: the law flies on prediction up to this age of the state; beyond ``lost_s`` the vehicle is released.
    ``fence_beyond`` is asked for when the vehicle, handed over at the hard fence, drifts on by another margin.
    ``innovation``: what the estimate's samples may differ from their prediction, 1 is twenty times a calm flight's.
    ``tilt_rad`` and ``speed_m_s`` are the vehicle's, not the command's. ``battery_fraction`` 0 switches that one off.
    ``deviation_m`` is between the vehicle and its reference, ``sink_m`` how far it sinks below that.
    ``round_trip_s``: what a link may take there and back for the control law to fly over it.
    """

    coast_s: float = 0.2
    lost_s: float = 0.5
    position_variance_m2: float = 0.3
    innovation: float = 1.0
    innovation_for_s: float = 1.0
    attitude_disagreement_rad: float = 0.26
    attitude_disagreement_for_s: float = 2.0
    tilt_rad: float = 1.3
    tilt_for_s: float = 0.3
    speed_m_s: float = 20.0
    speed_for_s: float = 0.5
    deviation_m: float = 4.0
    deviation_for_s: float = 3.0
    sink_m: float = 1.0
    sink_for_s: float = 0.5
    battery_fraction: float = 0.0
    battery_for_s: float = 5.0
    round_trip_s: float = 0.1
    round_trip_for_s: float = 0.3
    drift_m_s: float = 0.5
    drift_for_s: float = 2.0
    hysteresis: float = 0.8
    fence: Geofence = field(default_factory=Geofence)
    fence_beyond: FlightMode = FlightMode.HOLD


@value(eq=True)
class Facts:
    """One tick's facts: the newest accepted state, its age, what the estimator thinks of it, and the rest by name.

    ``deviation_ned_m`` is from the reference that was flown last to the vehicle. ``round_trip_s``: of the link, 0 where
    nothing is known of it. ``tick_s``: since the tick before.
    """

    status: AutopilotStatus
    state: EstimatedState | None = None
    age_s: float = inf
    position_variance_m2: float = 0.0
    variance_grows: bool = False
    innovation: float = 0.0
    disagreement_rad: float = 0.0
    truth_returned: bool = False
    goal_active: bool = False
    latched: bool = False
    deviation_ned_m: Vec3 = ZERO3
    round_trip_s: float = 0.0
    tick_s: float = 0.0


@value(eq=True)
class Conditions:
    """The facts as the table names them; those about requests are filled in by the supervision.

    ``overruled``: a failsafe that does not bring the vehicle down in the way that was asked of the autopilot.
    """

    link: bool = False
    rebooted: bool = False
    armed: bool = False
    in_flight: bool = False
    landed: bool = False
    in_air: bool = False
    terminated: bool = False
    failsafe: bool = False
    overruled: bool = False
    offboard: bool = False
    hold: bool = False
    takeoff: bool = False
    landing: bool = False
    engageable: bool = False
    state_usable: bool = False
    estimate_lost: bool = True
    estimate_poor: bool = False
    estimate_worsens: bool = False
    truth_returned: bool = False
    attitude_disagrees: bool = False
    tilt_excess: bool = False
    speed_excess: bool = False
    left_behind: bool = False
    link_slow: bool = False
    fence_crossed: bool = False
    fence_breached: bool = False
    fence_drifts: bool = False
    battery_low: bool = False
    goal_active: bool = False
    latched: bool = False
    engage_asked: bool = False
    release_asked: bool = False
    hold_confirmed: bool = False
    landing_confirmed: bool = False
    landing_late: bool = False
    takeoff_confirmed: bool = False
    release_confirmed: bool = False
    hold_stale: bool = False
    lost_while_ours: bool = False
    engage_over: bool = False
    release_levels: bool = False
    release_over: bool = False


@value(eq=True)
class Lasting:
    """Memory of one bound with hysteresis: since when it is exceeded (inf: it is not), and whether it counts."""

    since_s: float = inf
    active: bool = False


_NEVER = Lasting()


def lasting(memory: Lasting, value: float, bound: float, for_s: float, now_s: float, hysteresis: float) -> Lasting:
    """Active once ``value`` exceeded ``bound`` for ``for_s``, until below hysteresis times it. NaN exceeds."""
    limit = bound * hysteresis if memory.active else bound
    if value <= limit:
        return _NEVER
    since = min(memory.since_s, now_s)
    return Lasting(since, memory.active or now_s - since >= for_s)


@value(eq=True)
class Breach:
    """How far outside the vehicle was when it was first seen beyond the hard fence, as long as the fence stays."""

    outside_m: float
    anchor_ned_m: Vec3


@value(eq=True)
class Memory:
    """Hysteresis of all bounds, the breach that lasts, and the autopilot's boot count at the last tick."""

    boot_count: int | None = None
    breach: Breach | None = None
    drift: Lasting = _NEVER
    variance: Lasting = _NEVER
    innovation: Lasting = _NEVER
    disagreement: Lasting = _NEVER
    tilt: Lasting = _NEVER
    speed: Lasting = _NEVER
    deviation: Lasting = _NEVER
    sinking: Lasting = _NEVER
    round_trip: Lasting = _NEVER
    battery: Lasting = _NEVER


def in_flight(status: AutopilotStatus) -> bool:
    """Armed and not said to be on the ground."""
    return status.armed and status.landed is not LandedState.ON_GROUND


def evaluate(memory: Memory, facts: Facts, now_s: float, bounds: Bounds, **others: bool) -> tuple[Memory, Conditions]:
    """The conditions of this tick; ``others`` are those about requests, by name."""
    outside_m = -inf if facts.state is None else excess_m(bounds.fence, facts.state.position_ned_m)
    memory = _remember(memory, facts, outside_m, now_s, bounds)
    status = facts.status
    mode = status.mode
    critical = status.system_status >= SystemStatus.CRITICAL
    differs = FlightMode.UNKNOWN is not status.intended_mode is not mode is not FlightMode.UNKNOWN
    hold, landing = mode is FlightMode.HOLD, mode in LANDING_MODES
    failsafe = mode is not FlightMode.OFFBOARD and (critical or differs)
    poor = memory.variance.active or memory.innovation.active
    usable = facts.state is not None and facts.age_s <= bounds.coast_s
    return memory, Conditions(
        link=status.connected,
        armed=status.armed,
        in_flight=in_flight(status),
        landed=status.landed is LandedState.ON_GROUND,
        in_air=status.armed and status.landed is LandedState.IN_AIR,
        terminated=mode is FlightMode.TERMINATION or status.system_status >= SystemStatus.FLIGHT_TERMINATION,
        failsafe=failsafe,
        overruled=failsafe and (differs or not landing),
        offboard=mode is FlightMode.OFFBOARD,
        hold=hold,
        takeoff=mode is FlightMode.TAKEOFF,
        landing=landing,
        engageable=hold
        and status.heard
        and not status.airframe
        and status.armed
        and status.landed is LandedState.IN_AIR
        and status.system_status is SystemStatus.ACTIVE
        and not differs
        and status.battery_charge < BatteryCharge.CRITICAL
        and usable
        and not poor
        and not facts.variance_grows
        and not memory.disagreement.active
        and not memory.tilt.active
        and not memory.speed.active
        and not memory.round_trip.active
        and not memory.battery.active
        and memory.breach is None,
        state_usable=usable,
        estimate_lost=facts.age_s > bounds.lost_s,
        estimate_poor=poor,
        estimate_worsens=facts.variance_grows,
        truth_returned=facts.truth_returned,
        attitude_disagrees=memory.disagreement.active,
        tilt_excess=memory.tilt.active,
        speed_excess=memory.speed.active,
        left_behind=memory.deviation.active or memory.sinking.active,
        link_slow=memory.round_trip.active,
        fence_crossed=outside_m > 0.0,
        fence_breached=memory.breach is not None,
        fence_drifts=memory.drift.active,
        battery_low=memory.battery.active,
        goal_active=facts.goal_active,
        latched=facts.latched,
        **others,
    )


def _remember(memory: Memory, facts: Facts, outside_m: float, now_s: float, bounds: Bounds) -> Memory:
    state = facts.state
    breach = _breach(memory.breach, bounds.fence, outside_m)
    drift_m_s = 0.0 if state is None or breach is None else _drift_m_s(bounds.fence, breach, state, outside_m)
    battery = facts.status.battery_fraction
    shortage = bounds.battery_fraction - battery if battery is not None and bounds.battery_fraction > 0.0 else 0.0
    tilt_rad = 0.0 if state is None else tilt_of(state.attitude_wb)
    speed_m_s = 0.0 if state is None else norm(state.velocity_ned_m_s)
    sinks = state is not None and state.velocity_ned_m_s[2] > SINKING_M_S
    below_m = facts.deviation_ned_m[2] if sinks else 0.0
    keep = bounds.hysteresis
    after = Memory(
        facts.status.boot_count,
        breach,
        lasting(memory.drift, drift_m_s, bounds.drift_m_s, bounds.drift_for_s, now_s, keep),
        lasting(memory.variance, facts.position_variance_m2, bounds.position_variance_m2, 0.0, now_s, keep),
        lasting(memory.innovation, facts.innovation, bounds.innovation, bounds.innovation_for_s, now_s, keep),
        lasting(
            memory.disagreement,
            facts.disagreement_rad,
            bounds.attitude_disagreement_rad,
            bounds.attitude_disagreement_for_s,
            now_s,
            keep,
        ),
        lasting(memory.tilt, tilt_rad, bounds.tilt_rad, bounds.tilt_for_s, now_s, keep),
        lasting(memory.speed, speed_m_s, bounds.speed_m_s, bounds.speed_for_s, now_s, keep),
        lasting(memory.deviation, norm(facts.deviation_ned_m), bounds.deviation_m, bounds.deviation_for_s, now_s, keep),
        lasting(memory.sinking, below_m, bounds.sink_m, bounds.sink_for_s, now_s, keep),
        lasting(memory.round_trip, facts.round_trip_s, bounds.round_trip_s, bounds.round_trip_for_s, now_s, keep),
        lasting(memory.battery, shortage, 0.0, bounds.battery_for_s, now_s, keep),
    )
    return memory if after == memory else after


def _breach(before: Breach | None, fence: Geofence, outside_m: float) -> Breach | None:
    """A fence that moves about a vehicle that is outside of it begins a new breach: it is not the vehicle's drift."""
    if outside_m <= fence.hard_margin_m:
        return None
    if before is not None and before.anchor_ned_m == fence.anchor_ned_m:
        return before
    return Breach(outside_m, fence.anchor_ned_m)


def _drift_m_s(fence: Geofence, breach: Breach, state: EstimatedState, outside_m: float) -> float:
    """How fast the vehicle moves outwards; 0 until it is a margin farther than at the breach."""
    if not outside_m > breach.outside_m + fence.hard_margin_m:
        return 0.0
    soon_ned_m = add(state.position_ned_m, state.velocity_ned_m_s)
    return excess_m(fence, soon_ned_m) - outside_m
