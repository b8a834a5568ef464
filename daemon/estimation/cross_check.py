"""A second opinion on the tilt: a Mahony filter on the raw IMU beside the attitude that the autopilot reports.

An accelerometer reads specific force, so in accelerated flight it does not point along gravity: its weight falls to
zero as the low-passed length departs from g, and the gain is so low that a manoeuvre of a second or two, which may keep
the length near g, hardly tilts the filter. Heading is not compared: without a magnetometer there is none.

A gyro sample tells nothing of a gap before it. Over a gap the filter turns as the autopilot says that the vehicle did:
how far the two were apart stays, and the accelerometer goes on to correct. So neither does a turn in a gap look like a
disagreement, nor do gaps hide one, however often they come.
"""

from dataclasses import dataclass, field
from math import atan2, exp, hypot, isfinite

from daemon.estimation.mahony import (
    MahonyParameters,
    MahonyState,
    measure,
    propagate,
    with_orientation,
)
from daemon.frames import clamp, conjugate, cross, dot, multiply, norm, rotate_inverse
from daemon.messages import GRAVITY_M_S2, IDENTITY, Imu, Quat, Vec3
from daemon.values import value

_DOWN: Vec3 = (0.0, 0.0, 1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class CrossCheckParameters:
    """Gains of the filter and times of the comparison.

    ``force_band_m_s2``: departure of the specific force's length from g at which the accelerometer loses all weight.
    ``gap_s``: a longer time between samples is a gap; an older attitude is not compared.
    """

    mahony: MahonyParameters = field(default_factory=lambda: MahonyParameters(kp_1_s=0.2, ki_1_s2=0.005))
    force_smoothing_s: float = 0.1
    force_band_m_s2: float = 1.5
    smoothing_s: float = 1.0
    gap_s: float = 0.1


@value
class CrossCheckState:
    """The filter, the attitude that it was last compared with, and by how much they differ, low-passed."""

    imu: Imu | None = None
    filter: MahonyState = field(default_factory=MahonyState)
    attitude_wb: Quat = IDENTITY
    force_m_s2: float = GRAVITY_M_S2
    disagreement_rad: float = 0.0


def step(
    state: CrossCheckState, imu: Imu | None, attitude_wb: Quat | None, age_s: float, *, parameters: CrossCheckParameters
) -> CrossCheckState:
    """Take the newest IMU sample, when it is new, and compare with the newest attitude of the autopilot, ``age_s`` old.

    The filter starts from the autopilot's attitude, also when the IMU's clock was set back. While the attitude is too
    old, or still that of before a gap, nothing is taken.
    """
    if imu is None or imu is state.imu or attitude_wb is None or not _is_attitude(attitude_wb):
        return state
    dt_s = 0.0 if state.imu is None else (imu.stamp_us - state.imu.stamp_us) * 1e-6
    gap = dt_s > parameters.gap_s
    if age_s > parameters.gap_s or (gap and age_s > 0.5 * dt_s):
        return state
    if dt_s <= 0.0:
        return CrossCheckState(imu, with_orientation(state.filter, attitude_wb), attitude_wb)
    force = _smoothed(state.force_m_s2, norm(imu.specific_force_frd_m_s2), dt_s, parameters.force_smoothing_s)
    weight = clamp(1.0 - abs(force - GRAVITY_M_S2) / parameters.force_band_m_s2, 0.0, 1.0)
    measured = measure(
        _turned_alike(state, attitude_wb) if gap else state.filter,
        imu.specific_force_frd_m_s2,
        state.filter.bias_b_rad_s if gap else imu.rates_frd_rad_s,
        imu.magnetic_field_frd_gauss,
        parameters=parameters.mahony,
        accelerometer_weight=weight,
    )
    turning = propagate(measured, parameters=parameters.mahony, dt_s=min(dt_s, parameters.gap_s))
    apart = tilt_between(turning.attitude_wb, attitude_wb)
    disagreement = _smoothed(state.disagreement_rad, apart, dt_s, parameters.smoothing_s)
    return CrossCheckState(imu, turning, attitude_wb, force, disagreement)


def _turned_alike(state: CrossCheckState, attitude_wb: Quat) -> MahonyState:
    """The filter after the turn of the body that the autopilot tells of since the last comparison."""
    turn = multiply(conjugate(state.attitude_wb), attitude_wb)
    return with_orientation(state.filter, multiply(state.filter.attitude_wb, turn))


def tilt_between(a_wb: Quat, b_wb: Quat) -> float:
    """Angle between the verticals that two attitudes see from the body, in [0, pi]; headings do not count."""
    down_a, down_b = rotate_inverse(a_wb, _DOWN), rotate_inverse(b_wb, _DOWN)
    return atan2(norm(cross(down_a, down_b)), dot(down_a, down_b))


def _is_attitude(q: Quat) -> bool:
    return 0.5 < hypot(*q) < 2.0


def _smoothed(before: float, value: float, dt_s: float, time_constant_s: float) -> float:
    after = before + (value - before) * (1.0 - exp(-dt_s / time_constant_s))
    return after if isfinite(after) else before
