"""Parameters of the control law, and how they follow from the numbers of an airframe."""

from dataclasses import dataclass, fields
from enum import Enum
from math import inf, isfinite, pi, radians

from daemon.messages import GRAVITY_M_S2, Vec3


class AttitudeLaw(Enum):
    """Which law turns the attitude error into body rates."""

    QUATERNION = "quaternion"
    GEOMETRIC = "geometric"
    JERK = "jerk"


class HeadingAxis(Enum):
    """What points along the heading when the vehicle is tilted.

    ``NOSE``: the nose's horizontal projection (z-y-x angles). ``LATERAL``: the right side is square to the heading
    (z-x-y angles), as in mavros_controllers.
    """

    NOSE = "nose"
    LATERAL = "lateral"


@dataclass(frozen=True, slots=True, kw_only=True)
class ControlParameters:
    """Gains, vehicle numbers and limits of the control law; a number that makes no sense raises ValueError.

    Defaults fly a small quadrotor as simulated by PX4 (SIH). ``from_airframe`` derives the gains of another one.
    """

    # Vehicle
    hover_thrust: float = 0.5  # normalized command; start value, MPC_THR_HOVER
    thrust_curve: float = 0.0  # THR_MDL_FAC of what PX4 leaves uncompensated: force = c u^2 + (1 - c) u
    thrust_lag_s: float = 0.055  # first-order lag of thrust, after the dead time
    rate_lag_s: Vec3 = (0.055, 0.055, 0.31)  # first-order lag of the rate loops, after the dead time
    drag_1_s: Vec3 = (0.0, 0.0, 0.0)  # rotor drag over mass along the body axes; mavros_controllers: opposite sign
    gravity_m_s2: float = GRAVITY_M_S2

    # Position law
    position_gain_1_s2: Vec3 = (5.0, 5.0, 7.0)  # north, east, down
    velocity_gain_1_s: Vec3 = (3.2, 3.2, 4.4)  # north, east, down
    feedback_max_m_s2: float = 9.0  # feedback acceleration, horizontal norm, and vertical
    approach_max_m_s: float = 3.0  # speed at which a far reference is approached; inf: never saturates

    # Attitude law
    attitude_law: AttitudeLaw = AttitudeLaw.QUATERNION
    attitude_time_constant_s: Vec3 = (0.15, 0.15, 0.7)  # roll, pitch, yaw; shared by the three laws
    original_gain: bool = False  # the geometric law at twice the gain, as in mavros_controllers
    original_drag: bool = False  # drag at the attitude that flies without it, as in mavros_controllers
    heading_axis: HeadingAxis = HeadingAxis.NOSE
    heading_error_max_rad: float = 0.5  # yaw error that the law sees at most; pi: all of it
    rate_feed_forward: bool = True  # body rates from the reference's jerk and yaw rate
    lag_compensation: bool = True  # lead of feed-forward rates and thrust by the vehicle's lags

    # Learned in flight
    velocity_bias_bandwidth_rad_s: float = 4.0  # 0: off
    velocity_bias_max_m_s: float = 1.0  # horizontal norm, and vertical
    disturbance_bandwidth_rad_s: float = 13.0  # 0: off
    disturbance_max_m_s2: float = 6.0  # horizontal norm, and vertical
    hover_time_constant_s: float = 3.0  # how fast a vertical disturbance becomes hover thrust; inf: never
    hover_range: float = 0.5  # relative bound about the start value
    hover_tilt_max_rad: float = radians(15.0)  # learned below this tilt only
    drag_max_1_s: float = 2.0  # of configured and learned drag; 0: none is learned
    linear_thrust: tuple[float, float] | None = None  # thrust = k a + offset (1/(m/s2), -) instead of the hover thrust

    # Limits
    tilt_max_rad: float = radians(35.0)
    rate_max_rad_s: float = 3.8  # norm of roll and pitch rate
    yaw_rate_max_rad_s: float = 1.5
    rate_slew_max_rad_s2: float = 80.0  # norm over roll and pitch, and yaw
    thrust_min: float = 0.08
    thrust_max: float = 0.95
    thrust_slew_max_1_s: float = 8.0
    vertical_thrust_min_m_s2: float = 3.0  # upward part of thrust acceleration that is always kept

    def __post_init__(self) -> None:
        for field in fields(self):
            _require(_sound(getattr(self, field.name), field.name), field.name)
        _require(0.0 < self.hover_thrust < 1.0, "hover_thrust")
        _require(self.thrust_curve <= 1.0, "thrust_curve")
        _require(self.gravity_m_s2 > 1.0, "gravity_m_s2")
        _require(min(self.attitude_time_constant_s) > 0.0, "attitude_time_constant_s")
        _require(self.hover_time_constant_s > 0.0, "hover_time_constant_s")
        _require(self.hover_range < 1.0, "hover_range")
        _require(0.0 < self.tilt_max_rad <= radians(85.0), "tilt_max_rad")
        _require(0.0 <= self.thrust_min < self.thrust_max <= 1.0, "thrust_max")
        _require(self.vertical_thrust_min_m_s2 > 0.0, "vertical_thrust_min_m_s2")
        _require(self.rate_slew_max_rad_s2 > 0.0, "rate_slew_max_rad_s2")
        _require(self.thrust_slew_max_1_s > 0.0, "thrust_slew_max_1_s")


_MAY_BE_INFINITE = frozenset({"approach_max_m_s", "feedback_max_m_s2", "hover_time_constant_s"})
_MAY_BE_NEGATIVE = frozenset({"drag_1_s", "linear_thrust"})


def _sound(value: object, name: str) -> bool:
    if isinstance(value, tuple):
        return all(_sound(v, name) for v in value)
    if isinstance(value, float | int):
        low = -1e4 if name in _MAY_BE_NEGATIVE else 0.0
        return (isfinite(value) and low <= value < 1e4) or (value == inf and name in _MAY_BE_INFINITE)
    return True


def _require(condition: bool, name: str) -> None:
    if not condition:
        raise ValueError(f"control parameter {name} is out of range")


def from_airframe(
    hover_thrust: float, rate_lag_s: float, *, yaw_rate_lag_s: float | None = None, drag_1_s: Vec3 = (0.0, 0.0, 0.0)
) -> ControlParameters:
    """Gains from hover thrust and the first-order lag of the roll and pitch rate loop (yaw: 5.6 times it if unknown).

    The attitude loop closes 2.7 times (yaw: 2.3) slower than the rate loop; velocity, position and disturbance follow
    from it, so that each loop keeps the damping that it has on the default airframe.
    """
    yaw_lag_s = 5.6 * rate_lag_s if yaw_rate_lag_s is None else yaw_rate_lag_s
    default = ControlParameters()
    slower = rate_lag_s / default.rate_lag_s[0]
    kp, kv = default.position_gain_1_s2, default.velocity_gain_1_s
    return ControlParameters(
        hover_thrust=hover_thrust,
        rate_lag_s=(rate_lag_s, rate_lag_s, yaw_lag_s),
        drag_1_s=drag_1_s,
        position_gain_1_s2=(kp[0] / slower**2, kp[1] / slower**2, kp[2] / slower**2),
        velocity_gain_1_s=(kv[0] / slower, kv[1] / slower, kv[2] / slower),
        attitude_time_constant_s=(2.7 * rate_lag_s, 2.7 * rate_lag_s, 2.3 * yaw_lag_s),
        disturbance_bandwidth_rad_s=default.disturbance_bandwidth_rad_s / slower,
    )


def mavros_controllers() -> ControlParameters:
    """The geometric controller of mavros_controllers with its published defaults and without what is added here.

    Its heading convention and its line of thrust are options; limits are as wide as they go.
    """
    return ControlParameters(
        position_gain_1_s2=(8.0, 8.0, 10.0),
        velocity_gain_1_s=(1.5, 1.5, 3.3),
        approach_max_m_s=inf,
        attitude_time_constant_s=(0.1, 0.1, 0.1),
        original_gain=True,
        original_drag=True,
        heading_axis=HeadingAxis.LATERAL,
        heading_error_max_rad=pi,
        rate_feed_forward=False,
        lag_compensation=False,
        velocity_bias_bandwidth_rad_s=0.0,
        disturbance_bandwidth_rad_s=0.0,
        drag_max_1_s=0.0,
        hover_time_constant_s=inf,
        linear_thrust=(0.05, 0.1),
        tilt_max_rad=radians(85.0),
        rate_max_rad_s=20.0,
        yaw_rate_max_rad_s=20.0,
        rate_slew_max_rad_s2=9999.0,
        thrust_min=0.0,
        thrust_max=1.0,
        thrust_slew_max_1_s=9999.0,
        vertical_thrust_min_m_s2=0.1,
    )
