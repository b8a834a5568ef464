"""How long the saturated filter takes, worked out from its law without stepping it."""

from math import hypot, log, sqrt

from daemon.guidance.saturation import Cascade

_ARRIVAL_M = 0.05  # distance at which the estimate of the time to go ends
_SETTLING = 2.4  # time constants by which three equal poles settle later than one
_PASSING = 0.2  # of the distance: a start that needs more to stop its sideways motion stops first


def duration_s(gains: Cascade, offset_m: tuple[float, ...], velocity_m_s: tuple[float, ...]) -> float:
    """Time to come within reach of the goal: straight there, or to a stop first when the start passes it by."""
    distance, speed, limit = hypot(*offset_m), hypot(*velocity_m_s), gains.acceleration_m_s2
    towards = sum(o * v for o, v in zip(offset_m, velocity_m_s, strict=True)) / max(distance, _ARRIVAL_M)
    sideways = speed * speed - min(towards * towards, speed * speed)
    if run_out_m(gains, towards) <= distance and sideways / (2.0 * limit) <= _PASSING * distance:
        return _direct_s(gains, distance, towards, top_speed(gains, offset_m))
    onward = tuple(o - 0.5 * v * speed / limit for o, v in zip(offset_m, velocity_m_s, strict=True))
    return speed / limit + _direct_s(gains, hypot(*onward), 0.0, top_speed(gains, onward))


def _direct_s(gains: Cascade, distance: float, towards: float, top: float) -> float:
    """Run up, cruise, brake with constant deceleration, settle."""
    if distance < _ARRIVAL_M and abs(towards) < _ARRIVAL_M:
        return 0.0
    gain, braking, limit = gains.velocity_gain_1_s, gains.braking_m_s2, gains.acceleration_m_s2
    linear_m = braking / gain**2
    zeta = 0.5 * (gains.jerk_gain_1_s / gains.acceleration_gain_1_s - 1.0)
    slowest_1_s = gains.acceleration_gain_1_s * (zeta - sqrt(max(0.0, zeta * zeta - 1.0)))

    def run_up_m(speed: float) -> float:
        return (speed * speed - towards * abs(towards)) / (2.0 * limit)

    low, high = 0.0, top
    for _ in range(30):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if run_up_m(middle) + run_out_m(gains, middle) <= distance else (low, middle)
    speed = max(low, gain * _ARRIVAL_M)
    settle_from_m = min(run_out_m(gains, speed), linear_m)
    return (
        abs(speed - towards) / limit
        + max(0.0, distance - run_up_m(speed) - run_out_m(gains, speed)) / speed
        + max(0.0, speed - gain * linear_m) / braking
        + (log(max(1.0, settle_from_m / _ARRIVAL_M)) + _SETTLING) / slowest_1_s
    )


def run_out_m(gains: Cascade, speed: float) -> float:
    """Distance from which the approach begins at a speed: the inverse of ``approach_speed``."""
    gain, braking = gains.velocity_gain_1_s, gains.braking_m_s2
    if speed <= braking / gain:
        return speed / gain
    return speed * speed / (2.0 * braking) + 0.5 * braking / gain**2


def top_speed(gains: Cascade, offset_m: tuple[float, ...]) -> float:
    """The speed limit in the direction of an offset in the plane, or down or up."""
    return gains.speed_high_m_s if len(offset_m) == 2 or offset_m[0] >= 0.0 else -gains.speed_low_m_s
