"""The numbers of mavros_controllers' own C++, in its own frames (z up), through an adapter of frames."""

from dataclasses import replace
from math import pi

import pytest

from daemon import frames
from daemon.control import controller, flatness, position_law
from daemon.control.parameters import AttitudeLaw, HeadingAxis, mavros_controllers
from daemon.messages import IDENTITY, EstimatedState, Quat, Reference, Vec3

P, V = (0.1, -0.2, 1.9), (0.3, 0.1, -0.05)
P_REF, V_REF, A_REF = (0.5, 0.4, 2.0), (1.0, -0.5, 0.2), (0.2, 0.3, -0.1)
YAW, DRAG = 0.3, (0.1, 0.2, 0.05)
ATTITUDE_ENU: Quat = (0.998202535610156, 0.0180193198869555, 0.0268587923810624, 0.0504540115758718)
# the original takes the drag off where it should add to the thrust: the other sign
ORIGINAL = replace(mavros_controllers(), gravity_m_s2=9.8, drag_1_s=(-DRAG[0], -DRAG[1], -DRAG[2]))

ned = frames.ned_from_enu


def acc2quat(vector_enu: Vec3, yaw_enu: float) -> Quat:
    """The original's function, carried out by ours in its lateral convention; result in ENU/FLU with w >= 0."""
    q = flatness.attitude_from_thrust(ned(vector_enu), frames.yaw_ned_from_enu(yaw_enu), IDENTITY, HeadingAxis.LATERAL)
    # attitude_ned_from_enu is its own inverse up to sign: both factors are half turns
    return frames.attitude_ned_from_enu(q)


def flown(law: AttitudeLaw) -> tuple[controller.ControlRecord, Vec3, float]:
    state = EstimatedState(0.0, ned(P), ned(V), frames.attitude_ned_from_enu(ATTITUDE_ENU), (0.0, 0.0, 0.0))
    reference = Reference(0.0, ned(P_REF), ned(V_REF), ned(A_REF), yaw_rad=frames.yaw_ned_from_enu(YAW))
    parameters = replace(ORIGINAL, attitude_law=law)
    _, setpoint, record = controller.step(
        controller.initial(parameters), state, state, reference, 0.01, parameters=parameters
    )
    x, y, z = setpoint.rates_frd_rad_s
    return record, (x, -y, -z), setpoint.thrust


def test_acceleration_to_attitude() -> None:
    assert acc2quat((0.5, -0.3, 9.0), 0.1) == pytest.approx(ATTITUDE_ENU, abs=1e-9)
    assert acc2quat((0.0, 0.0, 1.0), 0.0) == pytest.approx(IDENTITY, abs=1e-9)


def test_feedback_acceleration() -> None:
    feedback = position_law.feedback(
        frames.subtract(ned(P), ned(P_REF)),
        frames.subtract(ned(V), ned(V_REF)),
        ORIGINAL.position_gain_1_s2,
        ORIGINAL.velocity_gain_1_s,
        approach_max_m_s=ORIGINAL.approach_max_m_s,
        feedback_max_m_s2=ORIGINAL.feedback_max_m_s2,
    )
    assert feedback == pytest.approx(ned((4.25, 3.9, 1.825)), abs=1e-9)


def test_rotor_drag() -> None:
    reference_wb = flatness.attitude_from_thrust(
        ned((0.2, 0.3, 9.7)), frames.yaw_ned_from_enu(YAW), IDENTITY, HeadingAxis.LATERAL
    )
    drag = flatness.rotor_drag(reference_wb, ned(V_REF), DRAG)
    expected = (0.122764053996996, -0.124589587175986, 0.0115798005518966)
    assert drag == pytest.approx(frames.scale(ned(expected), -1.0), abs=1e-9)


def test_quaternion_law_flown() -> None:
    record, rates_flu, thrust = flown(AttitudeLaw.QUATERNION)
    assert record.refused == () and record.limited == ()
    assert record.thrust_ned_m_s2 == pytest.approx(ned((4.327235946003, 4.32458958717599, 11.5134201994481)), abs=1e-9)
    desired = (0.962940583679051, -0.148552863654371, 0.190772675428738, 0.119512615709372)
    assert frames.attitude_ned_from_enu(record.desired_wb) == pytest.approx(desired, abs=1e-9)
    assert rates_flu == pytest.approx((-3.18444194678402, 3.48429942162411, 1.26572072591864), abs=1e-9)
    assert thrust == pytest.approx(0.679268983907311, abs=1e-9)


def test_geometric_law_flown_at_its_original_gain() -> None:
    _, rates_flu, _ = flown(AttitudeLaw.GEOMETRIC)
    assert rates_flu == pytest.approx((-6.17582216642868, 6.7573577920842, 2.45470517166464), abs=1e-9)


def test_yaw_adapter_is_the_physical_heading() -> None:
    level = acc2quat((0.0, 0.0, 9.8), YAW)
    assert frames.yaw_of(level) == pytest.approx(YAW)
    assert frames.yaw_ned_from_enu(0.0) == pytest.approx(pi / 2)
