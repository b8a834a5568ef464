"""Attitude, rates and thrust that fly a reference in rotor drag, against the dynamics solved by scipy."""

from math import degrees, pi, sin

import numpy as np
import pytest
from scipy.optimize import fsolve
from scipy.spatial.transform import Rotation

from daemon import frames
from daemon.control import flatness, law
from daemon.control.law import Flow
from daemon.control.parameters import ControlParameters, HeadingAxis
from daemon.control.reference_drag import reference_drag
from daemon.control.vehicle_model import VehicleModel
from daemon.messages import GRAVITY_M_S2, IDENTITY, EstimatedState, Quat, Reference, Vec3

GRAVITY = np.array([0.0, 0.0, GRAVITY_M_S2])
YAW_RATE_RAD_S = 0.7


def reference(t: float) -> Reference:
    """A lemniscate of 8 m that climbs and sinks, up to 7 m/s, while the nose turns."""

    def derivative(n: int) -> Vec3:
        def wave(size: float, w: float) -> float:
            return size * w**n * sin(w * t + n * pi / 2.0)

        return (wave(8.0, 0.6), wave(4.0, 1.2), wave(1.5, 0.5))

    yaw_rad = frames.wrap_pi(0.3 + YAW_RATE_RAD_S * t)
    return Reference(t, derivative(0), derivative(1), derivative(2), derivative(3), yaw_rad, YAW_RATE_RAD_S)


def exact(t: float, drag: Vec3) -> tuple[Rotation, float]:
    """Attitude and thrust (m/s2) with g - f z - R D R' v = a."""
    wanted = reference(t)

    def attitude(angles: np.ndarray) -> Rotation:
        return Rotation.from_euler("ZYX", [wanted.yaw_rad, angles[1], angles[0]])

    def left(unknown: np.ndarray) -> np.ndarray:
        body = attitude(unknown).as_matrix()
        drags = body @ np.diag(drag) @ body.T @ np.array(wanted.velocity_ned_m_s)
        return np.asarray(GRAVITY - drags - unknown[2] * body[:, 2] - np.array(wanted.acceleration_ned_m_s2))

    found = fsolve(left, [0.0, 0.0, GRAVITY_M_S2], xtol=1e-13)
    return attitude(found), float(found[2])


def flown(wanted: Reference, drag: Vec3, axis: HeadingAxis = HeadingAxis.NOSE) -> Flow:
    """One pass through the law for a vehicle that is where the reference is."""
    p = ControlParameters(drag_1_s=drag, heading_axis=axis, tilt_max_rad=1.4, lag_compensation=False)
    q = flatness.attitude_from_thrust(_bare(wanted), wanted.yaw_rad, IDENTITY)
    state = EstimatedState(wanted.time_s, wanted.position_ned_m, wanted.velocity_ned_m_s, q, (0.0, 0.0, 0.0))
    return law.fly(VehicleModel(hover_thrust=0.4), law.NOTHING, state, wanted, 0.01, p)


def _bare(wanted: Reference) -> Vec3:
    return frames.subtract(wanted.acceleration_ned_m_s2, (0.0, 0.0, GRAVITY_M_S2))


@pytest.mark.parametrize(
    ("drag", "angle_deg", "rate_rad_s", "thrust_m_s2"),
    [
        ((0.0, 0.0, 0.0), 1e-4, 1e-5, 1e-6),
        ((0.3, 0.3, 0.3), 1e-4, 1e-5, 1e-6),
        ((0.3, 0.3, 0.0), 1e-4, 1e-4, 1e-6),
        ((0.5, 0.2, 0.1), 0.01, 4e-4, 0.004),
        ((1.0, 1.0, 0.2), 1e-4, 0.01, 1e-6),
    ],
)
def test_attitude_rates_and_thrust_are_those_that_fly_the_reference(
    drag: Vec3, angle_deg: float, rate_rad_s: float, thrust_m_s2: float
) -> None:
    for t in np.linspace(0.0, 20.0, 60):
        body, length = exact(t, drag)
        behind, ahead = ((body.inv() * exact(t + h, drag)[0]).as_rotvec() for h in (-1e-4, 1e-4))
        record = flown(reference(t), drag).record
        found = Rotation.from_quat(record.desired_wb, scalar_first=True)
        assert degrees((found.inv() * body).magnitude()) < angle_deg
        assert frames.norm(record.thrust_ned_m_s2) == pytest.approx(length, abs=thrust_m_s2)
        fed = frames.rotate(_turn(record.desired_wb, wanted=reference(t)), record.feed_forward_frd_rad_s)
        assert fed == pytest.approx((ahead - behind) / 2e-4, abs=rate_rad_s)


def _turn(desired_wb: Quat, wanted: Reference) -> Quat:
    """From the body that flew in ``flown`` to the wanted one."""
    now_wb = flatness.attitude_from_thrust(_bare(wanted), wanted.yaw_rad, IDENTITY)
    return frames.multiply(frames.conjugate(desired_wb), now_wb)


@pytest.mark.parametrize("axis", HeadingAxis)
@pytest.mark.parametrize("drag", [(0.0, 0.0, 0.0), (0.5, 0.2, 0.1)])
def test_the_rates_that_are_fed_forward_turn_the_attitude_that_is_wanted(axis: HeadingAxis, drag: Vec3) -> None:
    for t in np.linspace(0.0, 20.0, 40):
        behind, now, ahead = (flown(reference(t + h), drag, axis).record for h in (-1e-4, 0.0, 1e-4))
        turned = frames.log(frames.multiply(frames.conjugate(behind.desired_wb), ahead.desired_wb))
        fed = frames.rotate(_turn(now.desired_wb, wanted=reference(t)), now.feed_forward_frd_rad_s)
        assert fed == pytest.approx(frames.scale(turned, 0.5 / 1e-4), abs=2e-3)


def test_the_derivative_is_that_of_the_drag() -> None:
    """The body turns under the drag: differences of the drag itself."""
    drag, h = (0.5, 0.2, 0.1), 1e-4

    def found(t: float) -> tuple[Vec3, Vec3]:
        return reference_drag(reference(t), _bare(reference(t)), IDENTITY, drag, HeadingAxis.NOSE)

    for t in np.linspace(0.0, 20.0, 40):
        change = frames.scale(frames.subtract(found(t + h)[0], found(t - h)[0]), 0.5 / h)
        assert found(t)[1] == pytest.approx(change, abs=0.02)


def test_a_drag_beyond_what_thrust_can_hold_is_still_a_number() -> None:
    fast = Reference(0.0, (0.0, 0.0, 0.0), (30.0, -20.0, 9.0), (3.0, 1.0, GRAVITY_M_S2), (9.0, 9.0, 9.0), 0.2, 1.0)
    for drag in ((5.0, 0.0, 1.0), (0.0, 5.0, 5.0), (5.0, 5.0, 0.0)):
        found = reference_drag(fast, _bare(fast), IDENTITY, drag, HeadingAxis.NOSE)
        assert all(frames.is_finite(vector) for vector in found)
        assert frames.norm(found[0]) <= 5.0 * frames.norm(fast.velocity_ned_m_s)
