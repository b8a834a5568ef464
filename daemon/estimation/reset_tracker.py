"""Which of the estimator's jumps happened, and by how much, from the counter and the prediction.

PX4 counts five kinds (velocity NE, velocity D, position NE, position D, attitude) but MAVLink carries only the sum of
the counters. So each sample is compared with the prediction from the sample before: what exceeds the noise of such a
prediction is named a kind. What cannot be told apart, and is named by ``ambiguity`` in the event:

- ``steps_beyond_kinds``: the counter stepped more often than kinds are seen: a kind moved by less than the noise
  (position resets of PX4 always count height and velocity that hardly move), or one kind was reset several times;
- ``kinds_beyond_steps``: more kinds are seen than the counter stepped: another EKF instance took over;
- ``none_seen``: the counter stepped and nothing moved by more than the noise;
- ``rebooted``: the autopilot's clock was set back and nothing fits: all numbers are new;
- ``after_gap``: the telemetry was silent for so long that motion and reset cannot be separated.

A reset of position from a correction of position (an origin that was moved, GPS that returned) only by the policy:
the numbers after it are the true ones when those before were beyond their bound, or when it is too large.
"""

from dataclasses import dataclass
from math import hypot

from daemon.estimation.gate import Sample
from daemon.estimation.predictor import moved
from daemon.frames import add, integrate, wrap_pi, yaw_of
from daemon.messages import ZERO3, FrameShift, Reset, Vec3
from daemon.values import value

POSITION_NE, POSITION_D = "position_ne", "position_d"
VELOCITY_NE, VELOCITY_D = "velocity_ne", "velocity_d"
HEADING = "heading"


@dataclass(frozen=True, slots=True, kw_only=True)
class ResetParameters:
    """What a prediction from sample to sample may miss, and the policy.

    ``*_noise_*``: of recorded innovations 999 of 1000 are within 0.04 m, 0.06 m/s and 0.3 deg.
    ``acceleration_unknown_m_s2`` and ``yaw_acceleration_unknown_rad_s2`` widen them with the time between the samples.
    ``acceleration_max_m_s2`` bounds the commanded acceleration that the prediction believes.
    ``gap_s``: after a longer silence the prediction says nothing.
    ``reset_max_m``: a larger jump of position is the return of the truth. ``variance_trusted_m2``: so is one after a
    position whose variance was larger.
    """

    position_noise_m: float = 0.06
    velocity_noise_m_s: float = 0.08
    yaw_noise_rad: float = 0.017
    acceleration_unknown_m_s2: float = 4.0
    yaw_acceleration_unknown_rad_s2: float = 4.0
    acceleration_max_m_s2: float = 40.0
    gap_s: float = 0.5
    reset_max_m: float = 20.0
    variance_trusted_m2: float = 0.3


@value
class Innovation:
    """What a sample has more than the prediction from the sample before, ``dt_s`` later, was."""

    dt_s: float
    position_ned_m: Vec3
    velocity_ned_m_s: Vec3
    yaw_rad: float


def innovation(before: Sample, after: Sample, acceleration_ned_m_s2: Vec3, dt_s: float) -> Innovation:
    """Compare ``after`` with ``before`` moved on by its velocity, the commanded acceleration and both mean rates."""
    (px, py, pz), (vx, vy, vz) = moved(before.position_ned_m, before.velocity_ned_m_s, acceleration_ned_m_s2, dt_s)
    x, y, z = after.position_ned_m
    wx, wy, wz = after.velocity_ned_m_s
    (p0, q0, r0), (p1, q1, r1) = before.rates_frd_rad_s, after.rates_frd_rad_s
    turned = integrate(before.attitude_wb, (0.5 * (p0 + p1), 0.5 * (q0 + q1), 0.5 * (r0 + r1)), dt_s)
    yaw = wrap_pi(yaw_of(after.attitude_wb) - yaw_of(turned))
    return Innovation(dt_s, (x - px, y - py, z - pz), (wx - vx, wy - vy, wz - vz), yaw)


def identified(
    found: Innovation, time_s: float, variance_before_m2: float, *, lost: bool = False, parameters: ResetParameters
) -> Reset:
    """The kinds that stand out of the noise, with their deltas (new minus old), and the policy's verdict.

    ``lost``: the frame before is lost whatever moved (a reboot, a reset in a long silence).
    """
    dt = found.dt_s
    position_noise = parameters.position_noise_m + 0.5 * parameters.acceleration_unknown_m_s2 * dt * dt
    velocity_noise = parameters.velocity_noise_m_s + parameters.acceleration_unknown_m_s2 * dt
    yaw_noise = parameters.yaw_noise_rad + 0.5 * parameters.yaw_acceleration_unknown_rad_s2 * dt * dt
    x, y, z = found.position_ned_m
    vx, vy, vz = found.velocity_ned_m_s
    kinds = set()
    dx = dy = dz = dvx = dvy = dvz = dyaw = 0.0
    if hypot(x, y) > position_noise:
        kinds.add(POSITION_NE)
        dx, dy = x, y
    if abs(z) > position_noise:
        kinds.add(POSITION_D)
        dz = z
    if hypot(vx, vy) > velocity_noise:
        kinds.add(VELOCITY_NE)
        dvx, dvy = vx, vy
    if abs(vz) > velocity_noise:
        kinds.add(VELOCITY_D)
        dvz = vz
    if abs(found.yaw_rad) > yaw_noise:
        kinds.add(HEADING)
        dyaw = found.yaw_rad
    jumped = POSITION_NE in kinds or POSITION_D in kinds
    far = hypot(dx, dy, dz) > parameters.reset_max_m
    untrusted = variance_before_m2 > parameters.variance_trusted_m2
    truth = lost or (jumped and (far or untrusted))
    return Reset(time_s, frozenset(kinds), (dx, dy, dz), (dvx, dvy, dvz), dyaw, truth)


def ambiguity(reset: Reset, counter_steps: int) -> str:
    """What cannot be told apart in this reset, see the module's text; empty when it is plain."""
    if not reset.kinds:
        return "none_seen"
    if counter_steps > len(reset.kinds):
        return "steps_beyond_kinds"
    return "kinds_beyond_steps" if counter_steps < len(reset.kinds) else ""


def accumulated(shift: FrameShift, reset: Reset) -> FrameShift:
    """The sum of the resets with one more. Position deltas add up as world vectors: headings do not turn them."""
    return FrameShift(
        shift.count + 1,
        reset.time_s,
        add(shift.position_ned_m, reset.position_ned_m),
        add(shift.velocity_ned_m_s, reset.velocity_ned_m_s),
        wrap_pi(shift.yaw_rad + reset.yaw_rad),
        ZERO3 if reset.truth_returned else add(shift.origin_ned_m, reset.position_ned_m),
    )
