"""Which pose each mode takes and which error it counts."""

from math import degrees, hypot, pi, radians, sin, sqrt

import pytest
from scipy.spatial.transform import Rotation

from daemon.frames import from_rpy, from_yaw, to_rpy, yaw_of
from daemon.guidance.convergence import Threshold, Tolerance, converged
from daemon.guidance.waypoint_modes import Pose, PoseError, WaypointMode, goal_pose, pose_error

NOW = Pose((1.0, 2.0, -3.0), from_rpy(0.1, -0.2, 0.5))
WANTED = Pose((4.0, 6.0, -9.0), from_rpy(0.2, 0.3, 1.5))


@pytest.mark.parametrize(
    ("mode", "position", "rpy"),
    [
        (WaypointMode.FULL_POSE, (4.0, 6.0, -9.0), (0.2, 0.3, 1.5)),
        (WaypointMode.ONLY_POSITION, (4.0, 6.0, -9.0), (0.1, -0.2, 0.5)),
        (WaypointMode.FORWARD_HEADING, (4.0, 6.0, -9.0), (0.0, 0.0, 0.9272952180016122)),
        (WaypointMode.ONLY_ORIENTATION, (1.0, 2.0, -3.0), (0.2, 0.3, 1.5)),
        (WaypointMode.POSITION_AND_YAW, (4.0, 6.0, -9.0), (0.0, 0.0, 1.5)),
        (WaypointMode.XY_AND_YAW, (4.0, 6.0, -3.0), (0.0, 0.0, 1.5)),
    ],
)
def test_goal_of_each_mode(
    mode: WaypointMode, position: tuple[float, float, float], rpy: tuple[float, float, float]
) -> None:
    goal = goal_pose(mode, WANTED, NOW)
    assert goal.position_ned_m == position
    assert to_rpy(goal.attitude_wb) == pytest.approx(rpy)


def test_forward_heading_straight_up_keeps_the_heading_of_now() -> None:
    goal = goal_pose(WaypointMode.FORWARD_HEADING, Pose((1.0, 2.0, -30.0), from_yaw(3.0)), NOW)
    assert yaw_of(goal.attitude_wb) == pytest.approx(0.5)


EP, EA = (0.3, -0.4, 1.2), 0.5
MEASURED = Pose(EP, from_yaw(EA))
GOAL = Pose((0.0, 0.0, 0.0), from_yaw(0.0))
CHORD = 2.0 * sin(EA / 2.0)


@pytest.mark.parametrize(
    ("mode", "combined"),
    [
        (WaypointMode.FULL_POSE, sqrt(1.3**2 + CHORD**2)),
        (WaypointMode.ONLY_POSITION, 1.3),
        (WaypointMode.FORWARD_HEADING, sqrt(1.3**2 + CHORD**2)),
        (WaypointMode.ONLY_ORIENTATION, CHORD),
        (WaypointMode.POSITION_AND_YAW, sqrt(1.3**2 + CHORD**2)),
        (WaypointMode.XY_AND_YAW, hypot(0.5, CHORD)),
    ],
)
def test_error_of_each_mode(mode: WaypointMode, combined: float) -> None:
    assert pose_error(mode, MEASURED, GOAL).combined == pytest.approx(combined)


def test_tilt_counts_only_where_the_whole_orientation_does() -> None:
    tilted = Pose((0.0, 0.0, 0.0), from_rpy(0.2, 0.0, 0.0))
    assert pose_error(WaypointMode.FULL_POSE, tilted, GOAL).angle_rad == pytest.approx(0.2)
    assert pose_error(WaypointMode.POSITION_AND_YAW, tilted, GOAL).angle_rad == pytest.approx(0.0, abs=1e-12)


def test_threshold_is_strict_and_has_no_dwell() -> None:
    at, below = PoseError(0.1, 0.0, 0.1), PoseError(0.0999, 0.0, 0.0999)
    assert not converged(Threshold(0.1), None, at, 9.0, 1.0)[1]
    assert converged(Threshold(0.1), None, below, 9.0, 1.0)[1]


@pytest.mark.parametrize("value", [0.0, -0.1, float("nan"), float("inf")])
def test_a_threshold_that_cannot_be_reached_is_refused(value: float) -> None:
    with pytest.raises(ValueError, match="threshold"):
        Threshold(value)
    with pytest.raises(ValueError, match="speed_m_s"):
        Tolerance(speed_m_s=value)


def test_tolerances_have_to_hold_for_the_dwell_without_a_break() -> None:
    good, bad = PoseError(0.1, 0.01, 0.1), PoseError(0.4, 0.01, 0.4)
    since, times, results = None, [0.0, 0.3, 0.4, 0.5, 0.8, 1.0], []
    for now, error in zip(times, [good, good, bad, good, good, good], strict=True):
        since, done = converged(Tolerance(), since, error, 0.1, now)
        results.append(done)
    assert results == [False, False, False, False, False, True]


@pytest.mark.parametrize(
    ("error", "speed"),
    [(PoseError(0.31, 0.0, 0.0), 0.0), (PoseError(0.0, 0.1, 0.0), 0.0), (PoseError(0.0, 0.0, 0.0), 0.31),
     (PoseError(float("nan"), 0.0, 0.0), 0.0)],
)  # fmt: skip
def test_each_tolerance_counts(error: PoseError, speed: float) -> None:
    assert converged(Tolerance(dwell_s=0.0), None, error, speed, 0.0) == (None, False)


@pytest.mark.parametrize("off_deg", [0.0, 1.0, 45.0, 90.0, 120.0, -179.0, 180.0])
@pytest.mark.parametrize("mode", [WaypointMode.FULL_POSE, WaypointMode.ONLY_ORIENTATION, WaypointMode.POSITION_AND_YAW])
def test_the_angle_is_that_of_the_turn_that_is_left(mode: WaypointMode, off_deg: float) -> None:
    """The one norm of position and angle keeps the original's 2 sin of half of it."""
    error = pose_error(
        mode, Pose((0.0, 0.0, 0.0), from_yaw(0.7 + radians(off_deg))), Pose((0.0, 0.0, 0.0), from_yaw(0.7))
    )
    assert degrees(error.angle_rad) == pytest.approx(abs(off_deg), abs=1e-6)
    assert error.combined == pytest.approx(2.0 * sin(radians(abs(off_deg)) / 2.0), abs=1e-12)


def test_the_angle_of_a_tilt_and_a_turn_is_that_of_both() -> None:
    measured = Pose((0.0, 0.0, 0.0), from_rpy(0.4, -0.8, 2.0))
    expected = Rotation.from_euler("ZYX", [2.0, -0.8, 0.4]).magnitude()
    assert pose_error(WaypointMode.FULL_POSE, measured, GOAL).angle_rad == pytest.approx(expected)


def test_a_tolerance_of_115_degrees_is_not_met_at_any_heading() -> None:
    error = pose_error(WaypointMode.POSITION_AND_YAW, Pose((0.0, 0.0, 0.0), from_yaw(pi)), GOAL)
    wide = Tolerance(angle_rad=radians(115.0), dwell_s=0.0)
    assert converged(wide, None, error, 0.0, 0.0) == (None, False)
