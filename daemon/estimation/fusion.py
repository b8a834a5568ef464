"""EKF or UKF in flight: the autopilot's odometry and poses from outside become one estimate.

The filter's state is FRD in local NED: position, roll-pitch-yaw, velocity in the body, rates in the body, acceleration
in the body. Its model knows no gravity, so z down is as good as z up (see ``motion_model``). The NED velocity of the
odometry is turned into the body with the odometry's own attitude; the commanded acceleration is the control term.

The autopilot's odometry is itself the output of a filter: its errors are not white, so its variance is never taken
below a floor, and ``position_variance_m2`` never reports less than the autopilot's own while it is the only source.
Poses from outside are in the local NED of the moment that their stamp names: one from before a reset is shifted by it.
"""

from dataclasses import dataclass, field, replace
from math import inf, isfinite

import numpy as np

from daemon.estimation import ekf, filter_base
from daemon.estimation.filter_base import Correction, FilterParameters, Measurement, Predictor, frozen
from daemon.estimation.filter_control import AccelerationControl, ControlParameters
from daemon.estimation.fusion_shift import shifted_filter, shifted_pose
from daemon.estimation.lagged import LaggedState, take
from daemon.frames import clamp, from_rpy, rotate, rotate_inverse, to_rpy
from daemon.messages import ZERO3, EstimatedState, ExternalPose, Reset, Vec3
from daemon.values import value

_VARIANCE_UNKNOWN = 1e6  # m2 or rad2
_RESETS_KEPT = 8  # more within the history of a late pose there will not be
ODOMETRY, POSE = "odometry", "pose"
_PROCESS_NOISE_1_S = (0.1,) * 3 + (1e-3,) * 3 + (0.3,) * 3 + (2.5,) * 3 + (1.0,) * 3
_LIMITS = (15.0, 15.0, 15.0, 1.0, 1.0, 1.0)  # m/s2: beyond what a multirotor of 2.5 g can be told


def flight_filter(predictor: Predictor = ekf.predict) -> FilterParameters:
    """The filter for a multirotor at 100 Hz, by either predictor.

    Process noise: the autopilot's velocity is off by 0.2 m/s for seconds, so the position has to follow the odometry's;
    the command misses the true acceleration by 1 m/s2 for 0.3 s; rates answer a command within 50 ms.
    """
    return FilterParameters(
        predictor=predictor,
        process_noise_1_s=frozen(np.diag(_PROCESS_NOISE_1_S)),
        initial_variance=1e4,  # what the odometry is not asked for is unknown
        max_delta_s=0.5,
        control=ControlParameters(timeout_s=0.2, acceleration_limits=_LIMITS),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FusionParameters:
    """The filter, and how far each source is believed (variances are floors; gates in sigmas of a whole message).

    ``odometry_axes``: update vector over position, roll-pitch-yaw, velocity, rates. Leave its position out when poses
    from outside shall rule alone. ``restart_s``: when no odometry was accepted for so long, the filter starts anew, and
    at once when it cannot be predicted any more.
    ``history_s``: how late a pose may come; each sample that it is late costs a replay, as much as a sample taken.
    """

    filter: FilterParameters = field(default_factory=flight_filter)
    odometry_axes: tuple[bool, ...] = (True,) * 12
    odometry_position_variance_m2: float = 0.01
    odometry_angle_variance_rad2: float = 3e-4
    odometry_velocity_variance_m2_s2: float = 0.01
    odometry_rates_variance_rad2_s2: float = 0.0064
    odometry_gate_sigma: float = 10.0
    pose_position_variance_m2: float = 1e-4
    pose_angle_variance_rad2: float = 3e-4
    pose_gate_sigma: float = 5.0
    pose_timeout_s: float = 0.5
    history_s: float = 0.3
    ahead_s: float = 0.02
    restart_s: float = 0.5


@value
class FusionState:
    """The filter with its history, what was taken last, and the resets that a late pose may still have to be told."""

    lagged: LaggedState
    sample: EstimatedState | None = None
    pose: ExternalPose | None = None
    resets: tuple[Reset, ...] = ()
    odometry_accepted_s: float = -inf
    pose_accepted_s: float = -inf


@value
class Fused:
    """Estimate of a tick, None before the first odometry; corrections made in it; ``restarted``: the filter gave up."""

    estimate: EstimatedState | None
    corrections: tuple[Correction, ...] = ()
    restarted: bool = False


def initial(parameters: FusionParameters) -> FusionState:
    """Nothing taken yet."""
    return FusionState(LaggedState(filter_base.initial(parameters.filter)))


def step(
    state: FusionState,
    sample: EstimatedState | None,
    pose: ExternalPose | None,
    acceleration_ned_m_s2: Vec3,
    now_s: float,
    *,
    parameters: FusionParameters,
) -> tuple[FusionState, Fused]:
    """One tick: take the accepted odometry and the pose when they are new.

    The estimate is that of the newest measurement's stamp: its age is honest, and the predictor carries it to now.

    ``acceleration_ned_m_s2``: what the control law commanded at the tick before. A pose stamped in the future, or older
    than the history, is refused by name in the corrections. Late ones are taken in where they belong. Raises nothing.
    """
    control = AccelerationControl(now_s, acceleration_ned_m_s2)
    state = replace(state, lagged=replace(state.lagged, state=replace(state.lagged.state, control=control)))
    corrections: tuple[Correction, ...] = ()
    restarted = False
    if sample is not None and sample is not state.sample:
        state, corrections, restarted = _take_odometry(state, sample, now_s, parameters)
    if pose is not None and pose is not state.pose:
        state, more = _take_pose(state, pose, now_s, parameters)
        corrections += more
    return state, Fused(_estimate(state, now_s, parameters), corrections, restarted)


def shifted(state: FusionState, reset: Reset) -> FusionState:
    """The filter and its history in the numbers after a reset; call it before the sample that brought it is taken."""
    resets = (*state.resets, reset)[-_RESETS_KEPT:]
    return replace(state, lagged=shifted_filter(state.lagged, reset), resets=resets)


def _take_odometry(
    state: FusionState, sample: EstimatedState, now_s: float, parameters: FusionParameters
) -> tuple[FusionState, tuple[Correction, ...], bool]:
    measurement = _odometry(sample, parameters)
    newest = state.lagged.state
    gap = newest.initialized and sample.time_s - newest.stamp_s > parameters.filter.max_delta_s
    if not gap:
        taken, corrections = take(state.lagged, measurement, parameters.filter, parameters.history_s)
        if corrections[0].refused is None:
            return replace(state, lagged=taken, sample=sample, odometry_accepted_s=now_s), corrections, False
        waits = now_s - state.odometry_accepted_s < parameters.restart_s
        if not newest.initialized or (waits and corrections[0].refused != "unpredicted"):
            return replace(state, lagged=taken, sample=sample), corrections, False
    fresh = LaggedState(replace(filter_base.initial(parameters.filter), control=newest.control))
    taken, corrections = take(fresh, measurement, parameters.filter, parameters.history_s)
    return replace(state, lagged=taken, sample=sample, odometry_accepted_s=now_s), corrections, True


def _take_pose(
    state: FusionState, pose: ExternalPose, now_s: float, parameters: FusionParameters
) -> tuple[FusionState, tuple[Correction, ...]]:
    state = replace(state, pose=pose)
    if not state.lagged.state.initialized:
        return state, (Correction(POSE, pose.stamp_s, "not_started"),)
    if pose.stamp_s > now_s + parameters.ahead_s:
        return state, (Correction(POSE, pose.stamp_s, "stamp_ahead"),)
    for reset in state.resets:
        if pose.stamp_s < reset.time_s:
            pose = shifted_pose(pose, reset)
    taken, corrections = take(state.lagged, _pose(pose, parameters), parameters.filter, parameters.history_s)
    accepted_s = now_s if corrections[0].refused is None else state.pose_accepted_s
    return replace(state, lagged=taken, pose_accepted_s=accepted_s), corrections


def _odometry(sample: EstimatedState, parameters: FusionParameters) -> Measurement:
    velocity_frd = rotate_inverse(sample.attitude_wb, sample.velocity_ned_m_s)
    values = (*sample.position_ned_m, *to_rpy(sample.attitude_wb), *velocity_frd, *sample.rates_frd_rad_s)
    variances = (
        *(_believed(sample.position_variance_m2, parameters.odometry_position_variance_m2),) * 3,
        *(parameters.odometry_angle_variance_rad2,) * 3,
        *(parameters.odometry_velocity_variance_m2_s2,) * 3,
        *(parameters.odometry_rates_variance_rad2_s2,) * 3,
    )
    indices = tuple(index for index, used in enumerate(parameters.odometry_axes) if used)
    return Measurement(
        sample.time_s,
        indices,
        np.array([values[index] for index in indices]),
        np.diag([variances[index] for index in indices]),
        parameters.odometry_gate_sigma,
        ODOMETRY,
    )


def _pose(pose: ExternalPose, parameters: FusionParameters) -> Measurement:
    values: tuple[float, ...] = pose.position_ned_m
    stated: tuple[float, ...] = pose.position_variance_m2 or ZERO3
    variances = [_believed(variance, parameters.pose_position_variance_m2) for variance in stated]
    if pose.attitude_wb is not None:
        values += to_rpy(pose.attitude_wb)
        stated = pose.angle_variance_rad2 or ZERO3
        variances += [_believed(variance, parameters.pose_angle_variance_rad2) for variance in stated]
    return Measurement(
        pose.stamp_s,
        tuple(range(len(values))),
        np.array(values),
        np.diag(variances),
        parameters.pose_gate_sigma,
        POSE,
    )


def _estimate(state: FusionState, now_s: float, parameters: FusionParameters) -> EstimatedState | None:
    newest = state.lagged.state
    if not newest.initialized or state.sample is None:
        return None
    x = newest.x.tolist()
    attitude = from_rpy(x[3], x[4], x[5])
    variance = float(newest.P.diagonal()[:3].max())
    if now_s - state.pose_accepted_s > parameters.pose_timeout_s:
        variance = max(variance, _believed(state.sample.position_variance_m2, 0.0))
    return EstimatedState(
        newest.stamp_s,
        (x[0], x[1], x[2]),
        rotate(attitude, (x[6], x[7], x[8])),
        attitude,
        (x[9], x[10], x[11]),
        variance,
    )


def _believed(variance: float, floor: float) -> float:
    """A stated variance within sane bounds; unknown (NaN) is as good as nothing."""
    return clamp(variance, floor, _VARIANCE_UNKNOWN) if isfinite(variance) else _VARIANCE_UNKNOWN
