"""Which inputs of the law can be calculated with."""

from math import isfinite

from daemon.messages import EstimatedState, Quat, Reference, Reset, Vec3

BOUND = 1e6  # metres, m/s, m/s2, rad: beyond it a number is no state of a multirotor, and squares stay finite below it
_NORM_SQUARED = (0.5, 1.5)  # of an attitude that is still a rotation
_DT_S = (0.001, 0.1)
_DT_DEFAULT_S = 0.01


def refusals(estimate: EstimatedState, predicted: EstimatedState, reference: Reference | None) -> tuple[str, ...]:
    """Names of the inputs that are not finite, out of range or no rotation."""
    sound_estimate = sound_state(estimate)
    sound_predicted = sound_estimate if predicted is estimate else sound_state(predicted)
    if sound_estimate and sound_predicted and (reference is None or _sound_reference(reference)):
        return ()
    names = (("estimate", sound_estimate), ("predicted", sound_predicted))
    refused = tuple(name for name, sound in names if not sound)
    return refused if reference is None or _sound_reference(reference) else (*refused, "reference")


def sound_state(state: EstimatedState) -> bool:
    """True when all numbers are in range and the attitude is a rotation."""
    return (
        isfinite(state.time_s)
        and _size(state.position_ned_m) + _size(state.velocity_ned_m_s) + _size(state.rates_frd_rad_s) < BOUND
        and _rotation(state.attitude_wb)
    )


def sound_reset(reset: Reset) -> bool:
    """True when all numbers of a jump are in range."""
    return _size(reset.position_ned_m) + _size(reset.velocity_ned_m_s) + abs(reset.yaw_rad) < BOUND


def sound_dt_s(dt_s: float) -> float:
    """The step in seconds within 1 to 100 ms; 10 ms when it is not a number."""
    return min(max(dt_s, _DT_S[0]), _DT_S[1]) if isfinite(dt_s) else _DT_DEFAULT_S


def _sound_reference(r: Reference) -> bool:
    size = _size(r.position_ned_m) + _size(r.velocity_ned_m_s) + _size(r.acceleration_ned_m_s2)
    return size + _size(r.jerk_ned_m_s3) + abs(r.yaw_rad) + abs(r.yaw_rate_rad_s) < BOUND


def _size(v: Vec3) -> float:
    return abs(v[0]) + abs(v[1]) + abs(v[2])


def _rotation(q: Quat) -> bool:
    w, x, y, z = q
    return _NORM_SQUARED[0] < w * w + x * x + y * y + z * z < _NORM_SQUARED[1]
