"""The filter's original forms against numbers of the original C++, and the better forms against their meaning."""

from math import cos, pi, radians, sin

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from daemon.frames import angle_between, from_rpy, from_yaw
from daemon.guidance.reference_filter import (
    AxisLimits,
    FilterParameters,
    FilterState,
    Integrator,
    RotationError,
    rotation_error,
    set_reference,
    snap,
    step,
)
from daemon.guidance.waypoint_modes import Pose, WaypointMode, goal_pose
from daemon.messages import IDENTITY, ZERO3

ORIGIN = Pose(ZERO3, IDENTITY)
TOLERANCE = 1e-12
ONE_METRE = Pose((1.0, 0.0, 0.0), IDENTITY)
QUARTER_TURN = Pose(ZERO3, (cos(pi / 4), 0.0, 0.0, sin(pi / 4)))


def original(omega: float) -> FilterParameters:
    return FilterParameters(
        omega_rad_s=(omega,) * 6, integrator=Integrator.EULER, rotation_error=RotationError.VECTOR_PART
    )


def fly(goal: Pose, parameters: FilterParameters, steps: int, start: FilterState | None = None) -> FilterState:
    state = start or FilterState(ORIGIN)
    for _ in range(steps):
        state = step(state, goal, parameters)
    return state


@pytest.mark.parametrize(
    ("omega", "steps", "x"),
    [
        (1.0, 1, 0.0),
        (1.0, 2, 0.0),
        (1.0, 3, 1e-6),
        (1.0, 100, 0.0793732022521804),
        (1.0, 500, 0.876614225646418),
        (1.0, 1000, 0.997320568006208),
        (0.2, 100, 0.0011191032510573),
        (0.2, 1000, 0.323323493412636),
        (0.2, 2000, 0.762189989121651),
        (0.2, 3000, 0.938209670608177),
    ],
)
def test_position_of_the_original_form(omega: float, steps: int, x: float) -> None:
    assert fly(ONE_METRE, original(omega), steps).pose.position_ned_m[0] == pytest.approx(x, abs=TOLERANCE)


@pytest.mark.parametrize(
    ("steps", "vx"),
    [
        (1, 0.0),
        (2, 1e-4),
        (3, 2.97e-4),
        (100, 0.184864818824863),
        (500, 0.0836310335211945),
        (1000, 0.00220018754021285),
    ],
)
def test_velocity_of_the_original_form(steps: int, vx: float) -> None:
    assert fly(ONE_METRE, original(1.0), steps).velocity_ned_m_s[0] == pytest.approx(vx, abs=TOLERANCE)


@pytest.mark.parametrize(
    ("steps", "w", "z", "rate"),
    [
        (100, 0.998419291104718, 0.0562042627382742, 0.262603719466872),
        (500, 0.785786841451271, 0.618497404846645, 0.148556189090137),
        (1000, 0.709286738596678, 0.70492008231493, None),
    ],
)
def test_turn_of_the_original_form(steps: int, w: float, z: float, rate: float | None) -> None:
    state = fly(QUARTER_TURN, original(1.0), steps)
    assert state.pose.attitude_wb == pytest.approx((w, 0.0, 0.0, z), abs=TOLERANCE)
    if rate is not None:
        assert state.rates_frd_rad_s[2] == pytest.approx(rate, abs=TOLERANCE)


def test_forward_heading_of_the_original_form() -> None:
    goal = goal_pose(WaypointMode.FORWARD_HEADING, Pose((3.0, 4.0, -2.0), IDENTITY), ORIGIN)
    assert goal.attitude_wb == pytest.approx((0.894427190999916, 0.0, 0.0, 0.447213595499958), abs=TOLERANCE)
    state = fly(goal, original(1.0), 100)
    expected = (0.238119606756541, 0.317492809008721, -0.158746404504361)
    assert state.pose.position_ned_m == pytest.approx(expected, abs=TOLERANCE)
    assert state.pose.attitude_wb[3] == pytest.approx(0.0355139946504558, abs=TOLERANCE)
    assert state.rates_frd_rad_s[2] == pytest.approx(0.165612801844825, abs=TOLERANCE)


def test_exact_steps_follow_the_step_response_of_three_equal_poles() -> None:
    for omega, dt_s, steps in ((1.0, 0.01, 300), (1.7, 0.25, 8)):
        t = omega * dt_s * steps
        expected = 1.0 - (1.0 + t + t * t / 2.0) * 2.718281828459045**-t
        state = fly(ONE_METRE, FilterParameters(omega_rad_s=(omega,) * 6, dt_s=dt_s), steps)
        assert state.pose.position_ned_m[0] == pytest.approx(expected, abs=1e-12)


def test_rotation_error_by_logarithm_is_the_angle_and_by_vector_part_saturates() -> None:
    goal = from_yaw(radians(90.0))
    assert rotation_error(IDENTITY, goal, RotationError.LOGARITHM)[2] == pytest.approx(pi / 2)
    assert rotation_error(IDENTITY, goal, RotationError.VECTOR_PART)[2] == pytest.approx(1.414, abs=1e-3)


def test_rotation_error_agrees_with_scipy_and_goes_the_shorter_way() -> None:
    nominal, goal = from_rpy(0.4, -0.3, 3.0), from_rpy(-0.2, 0.5, -3.0)
    turn = Rotation.from_quat(nominal, scalar_first=True).inv() * Rotation.from_quat(goal, scalar_first=True)
    flipped = (-goal[0], -goal[1], -goal[2], -goal[3])
    for same in (goal, flipped):
        found = rotation_error(nominal, same, RotationError.LOGARITHM)
        assert found == pytest.approx(tuple(turn.as_rotvec()), abs=1e-12)
        chord = rotation_error(nominal, same, RotationError.VECTOR_PART)
        assert chord == pytest.approx(tuple(2.0 * turn.as_quat(canonical=True)[:3]), abs=1e-12)


def test_rates_are_those_of_the_body_far_from_the_identity() -> None:
    state = fly(Pose(ZERO3, from_rpy(1.0, -0.8, 2.0)), FilterParameters(), 150)
    later = step(state, Pose(ZERO3, from_rpy(1.0, -0.8, 2.0)), FilterParameters())
    turn = (
        Rotation.from_quat(state.pose.attitude_wb, scalar_first=True).inv()
        * Rotation.from_quat(later.pose.attitude_wb, scalar_first=True)
    ).as_rotvec() / 0.01
    mean = [(a + b) / 2.0 for a, b in zip(state.rates_frd_rad_s, later.rates_frd_rad_s, strict=True)]
    assert mean == pytest.approx(list(turn), abs=1e-5)


def test_starts_from_pose_and_twist_without_a_jump() -> None:
    start = FilterState(Pose((5.0, -2.0, 1.0), from_yaw(1.0)), (1.0, 2.0, -0.5), (0.0, 0.0, 0.3))
    state = fly(ONE_METRE, FilterParameters(), 1, start)
    assert state.pose.position_ned_m == pytest.approx((5.01, -1.98, 0.995), abs=1e-4)
    assert state.velocity_ned_m_s == pytest.approx(start.velocity_ned_m_s, abs=0.05)


def test_a_new_reference_in_flight_leaves_the_state_and_sees_the_filters_pose() -> None:
    state = fly(ONE_METRE, FilterParameters(), 120)
    goal = set_reference(state, WaypointMode.ONLY_ORIENTATION, Pose((9.0, 9.0, 9.0), from_yaw(1.0)))
    assert goal.position_ned_m == state.pose.position_ned_m
    after = step(state, goal, FilterParameters())
    assert after.velocity_ned_m_s[0] == pytest.approx(state.velocity_ned_m_s[0], abs=0.02)


def test_snap_puts_everything_to_rest_in_the_goal() -> None:
    state = snap(QUARTER_TURN)
    assert (state.velocity_ned_m_s, state.acceleration_ned_m_s2) == (ZERO3, ZERO3)
    assert step(state, QUARTER_TURN, FilterParameters()).pose.attitude_wb == pytest.approx(QUARTER_TURN.attitude_wb)


@settings(max_examples=25, deadline=None)
@given(
    roll=st.floats(-3.0, 3.0),
    pitch=st.floats(-1.5, 1.5),
    yaw=st.floats(-3.1, 3.1),
    x=st.floats(-20.0, 20.0),
    limit=st.floats(0.3, 3.0),
    jerk=st.floats(2.0, 20.0),
)
def test_saturated_form_keeps_its_limits_and_arrives(
    roll: float, pitch: float, yaw: float, x: float, limit: float, jerk: float
) -> None:
    goal = Pose((x, -x / 2.0, 1.0), from_rpy(roll, pitch, yaw))
    limits = AxisLimits(velocity=limit, acceleration=limit, jerk=jerk)
    parameters = FilterParameters(omega_rad_s=(1.5,) * 6, dt_s=0.02, linear_limits=limits, angular_limits=limits)
    state, slack = FilterState(ORIGIN), 1.0 + 1e-9
    for _ in range(round((abs(x) / limit + 20.0) / 0.02)):
        before, state = state, step(state, goal, parameters)
        for i in range(3):
            assert abs(state.velocity_ned_m_s[i]) <= limit * slack
            assert abs(state.rates_frd_rad_s[i]) <= limit * slack
            assert abs(state.acceleration_ned_m_s2[i]) <= limit * slack
            assert abs(state.angular_acceleration_frd_rad_s2[i]) <= limit * slack
            change = abs(state.acceleration_ned_m_s2[i] - before.acceleration_ned_m_s2[i])
            assert change <= jerk * 0.02 * slack
    assert state.pose.position_ned_m == pytest.approx(goal.position_ned_m, abs=0.02)
    assert angle_between(state.pose.attitude_wb, goal.attitude_wb) < 0.02
