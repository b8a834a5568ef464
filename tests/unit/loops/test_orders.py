"""From a goal as it came over the socket to an order: frames, units, limits, and the field of each refusal."""

import asyncio
from dataclasses import replace
from math import cos, dist, pi, radians, sin, sqrt
from typing import Any

import pymap3d
import pytest
from support.trajectory_rig import LIMITS

from daemon import orders
from daemon.frames import wrap_pi, yaw_of
from daemon.goals.errors import ErrorCode, ProtocolError
from daemon.goals.methods import EstimatorPose, GoalSubmit, ReferenceSet
from daemon.goals.schema import Waypoint
from daemon.guidance.convergence import Threshold, Tolerance
from daemon.guidance.goals import Goal, HoldGoal, PathGoal, PolynomialGoal, ShapeGoal, StreamGoal, Through, WaypointGoal
from daemon.guidance.heading import FixedHeading, PointHeading, TargetHeading, VelocityHeading
from daemon.guidance.parameters import GuidanceParameters
from daemon.guidance.waypoint_modes import WaypointMode
from daemon.loops.goal_order import GoalOrder
from daemon.messages import AutopilotStatus, GlobalPosition, Reference, Vec3
from daemon.orders import Place
from daemon.safety.geofence import Geofence
from daemon.sim.virtual_time import run_virtual

ORIGIN = GlobalPosition(47.397742, 8.545594, 488.0)
YAW = radians(30.0)
HERE: Vec3 = (2.0, 3.0, -10.0)
FENCE = Geofence(radius_m=100.0, floor_m=1.0, ceiling_m=50.0)
PLACE = Place(
    flown=Reference(7.0, (2.4, 2.8, -10.0), yaw_rad=YAW - 0.1),
    here=Reference(7.0, HERE, yaw_rad=YAW),
    status=AutopilotStatus(connected=True, global_origin=ORIGIN),
    fence=FENCE,
    max_distance_m=90.0,
    limits=LIMITS,
    parameters=GuidanceParameters(),
)


def order_of(place: Place = PLACE, **params: Any) -> GoalOrder:
    async def main() -> GoalOrder:
        return await orders.order("g1", GoalSubmit.model_validate(params), place, 4)

    return run_virtual(main())


def goal_of(place: Place = PLACE, **params: Any) -> Goal:
    return order_of(place, **params).goal


def waypoint_of(place: Place = PLACE, **waypoint: Any) -> WaypointGoal:
    goal = goal_of(place, waypoint=waypoint)
    assert isinstance(goal, WaypointGoal) and goal.position_ned_m is not None
    return goal


def refusal_of(place: Place = PLACE, **params: Any) -> ProtocolError:
    with pytest.raises(ProtocolError) as error:
        order_of(place, **params)
    return error.value


def ahead(forward: float, right: float, down: float) -> Vec3:
    """From where the vehicle is and heads, by trigonometry of the heading."""
    return (
        HERE[0] + forward * cos(YAW) - right * sin(YAW),
        HERE[1] + forward * sin(YAW) + right * cos(YAW),
        HERE[2] + down,
    )


@pytest.mark.parametrize(
    ("frame", "position", "expected"),
    [
        ("local_ned", [10.0, -4.0, -12.0], (10.0, -4.0, -12.0)),
        ("local_enu", [10.0, -4.0, 12.0], (-4.0, 10.0, -12.0)),
        ("body_frd", [5.0, 2.0, -1.0], ahead(5.0, 2.0, -1.0)),
    ],
)
def test_a_position_means_the_same_place_in_every_frame(frame: str, position: list[float], expected: Vec3) -> None:
    found = waypoint_of(frame=frame, position=position).position_ned_m
    assert found is not None and dist(found, expected) < 1e-9


def test_a_global_position_is_where_pymap3d_says() -> None:
    given = [47.3981, 8.5461, 500.0]
    found = waypoint_of(frame="global", position=given).position_ned_m
    expected = pymap3d.geodetic2ned(*given, ORIGIN.latitude_deg, ORIGIN.longitude_deg, ORIGIN.altitude_amsl_m)
    assert found is not None and dist(found, expected) < 0.01


def test_a_global_goal_is_made_anew_for_another_origin_and_a_local_one_is_not() -> None:
    goal = {"frame": "global", "position": [ORIGIN.latitude_deg, ORIGIN.longitude_deg, 500.0]}
    order = order_of(waypoint=goal)
    assert order.resolve is not None
    moved = replace(PLACE.status, global_origin=replace(ORIGIN, altitude_amsl_m=490.0))
    again = order.resolve(moved)
    assert isinstance(again, WaypointGoal) and again.position_ned_m is not None
    assert again.position_ned_m[2] == pytest.approx(-10.0, abs=1e-6)
    assert order_of(waypoint={"position": [1.0, 2.0, -9.0]}).resolve is None
    path = {"waypoints": [{"position": [1.0, 2.0, -9.0]}, goal]}
    assert order_of(path=path).resolve is not None


def test_without_an_origin_a_global_goal_is_not_possible() -> None:
    place = replace(PLACE, status=AutopilotStatus(connected=True))
    error = refusal_of(place, waypoint={"frame": "global", "position": [47.0, 8.0, 500.0]})
    assert (error.code, error.field) == (ErrorCode.WRONG_STATE, "waypoint.frame")


@pytest.mark.parametrize(
    ("frame", "yaw_deg", "expected_rad"),
    [
        ("local_ned", 100.0, radians(100.0)),
        ("local_ned", 200.0, radians(-160.0)),
        ("local_enu", 0.0, pi / 2),
        ("local_enu", 90.0, 0.0),
        ("local_enu", 180.0, -pi / 2),
        ("body_frd", 45.0, radians(75.0)),
        ("body_frd", 170.0, radians(-160.0)),
    ],
)
def test_a_yaw_is_turned_as_its_frame_counts_it(frame: str, yaw_deg: float, expected_rad: float) -> None:
    height = 12.0 if frame == "local_enu" else -2.0 if frame == "body_frd" else -12.0
    goal = waypoint_of(frame=frame, position=[1.0, 1.0, height], yaw_deg=yaw_deg)
    assert goal.attitude_wb is not None
    assert abs(wrap_pi(yaw_of(goal.attitude_wb) - expected_rad)) < 1e-9


@pytest.mark.parametrize(
    ("frame", "orientation", "expected_rad"),
    [
        ("local_ned", [sqrt(0.5), 0.0, 0.0, sqrt(0.5)], pi / 2),
        ("body_frd", [sqrt(0.5), 0.0, 0.0, sqrt(0.5)], pi / 2 + YAW),
        # body FRD to ENU, level, nose east: x stays, y to the south, z down: half a turn about x.
        ("local_enu", [0.0, 1.0, 0.0, 0.0], pi / 2),
    ],
)
def test_an_orientation_is_body_frd_to_its_frame(frame: str, orientation: list[float], expected_rad: float) -> None:
    height = 12.0 if frame == "local_enu" else -2.0 if frame == "body_frd" else -12.0
    goal = waypoint_of(frame=frame, position=[1.0, 1.0, height], orientation=orientation)
    assert goal.attitude_wb is not None
    assert abs(wrap_pi(yaw_of(goal.attitude_wb) - expected_rad)) < 1e-9


def test_a_waypoint_carries_mode_hold_and_convergence() -> None:
    position = [1.0, 1.0, -9.0]
    plain = waypoint_of(position=position)
    assert (plain.mode, plain.hold_s, plain.attitude_wb) == (WaypointMode.FULL_POSE, 0.0, None)
    assert plain.convergence == Tolerance(position_m=0.3, angle_rad=radians(5.0), speed_m_s=0.3, dwell_s=0.5)
    tight = {"position_m": 0.1, "angle_deg": 2.0, "speed_m_s": 0.2, "dwell_s": 1.0}
    goal = waypoint_of(position=position, mode="xy_and_yaw", hold_s=3.0, convergence=tight)
    assert (goal.mode, goal.hold_s) == (WaypointMode.XY_AND_YAW, 3.0)
    assert goal.convergence == Tolerance(position_m=0.1, angle_rad=radians(2.0), speed_m_s=0.2, dwell_s=1.0)
    assert waypoint_of(position=position, threshold=0.2).convergence == Threshold(0.2)


def test_limits_may_only_tighten() -> None:
    position = {"position": [1.0, 1.0, -9.0]}
    tight = order_of(waypoint=position, limits={"speed_m_s": 1.0, "yaw_rate_deg_s": 10.0}).limits
    assert (tight.speed_m_s, tight.climb_m_s, tight.descent_m_s) == (1.0, 1.0, 1.0)
    assert tight.yaw_rate_rad_s == pytest.approx(radians(10.0))
    wide = order_of(waypoint=position, limits={"speed_m_s": 50.0, "acceleration_m_s2": 50.0, "jerk_m_s3": 500.0})
    assert wide.limits == LIMITS
    assert order_of(waypoint=position).limits == LIMITS


def test_an_order_carries_id_kind_time_out_and_connection() -> None:
    order = order_of(waypoint={"position": [1.0, 1.0, -9.0]}, timeout_s=9.0)
    assert (order.goal_id, order.kind, order.timeout_s, order.connection) == ("g1", "waypoint", 9.0, 4)
    assert order_of(stream={}).kind == "stream"
    assert order_of(trajectory={"kind": "hold", "duration_s": 1.0}).kind == "trajectory"


@pytest.mark.parametrize(("through", "long"), [("stop", False), ("fly_by", True)])
def test_a_path_keeps_its_waypoints_and_tells_whether_planning_is_long(through: str, long: bool) -> None:
    corners = [[5.0, 0.0, -10.0], [5.0, 5.0, -12.0]]
    order = order_of(path={"waypoints": [{"position": corner} for corner in corners], "through": through})
    assert isinstance(order.goal, PathGoal)
    assert [list(w.position_ned_m or ()) for w in order.goal.waypoints] == corners
    assert order.goal.through is Through(through)
    assert order.plans_long is long


def test_shapes_turn_with_their_frame() -> None:
    circle = {"kind": "circle", "radius_m": 4.0, "speed_m_s": 1.0}
    enu = goal_of(trajectory=circle | {"frame": "local_enu", "center": [1.0, 2.0, 15.0], "axis": [0.0, 0.5, 1.0]})
    assert isinstance(enu, ShapeGoal)
    assert (enu.shape.center_ned_m, enu.shape.axis_ned) == ((2.0, 1.0, -15.0), (0.5, 0.0, -1.0))
    body = goal_of(trajectory=circle | {"frame": "body_frd", "center": [6.0, 0.0, 0.0], "axis": [1.0, 0.0, 1.0]})
    assert isinstance(body, ShapeGoal)
    assert dist(body.shape.center_ned_m, ahead(6.0, 0.0, 0.0)) < 1e-9
    assert dist(body.shape.axis_ned, (cos(YAW), sin(YAW), 1.0)) < 1e-9
    assert body.clockwise and body.rate_rad_s == pytest.approx(0.25)
    other = goal_of(
        trajectory={
            "kind": "lemniscate",
            "center": [0.0, 0.0, -10.0],
            "size_m": [6.0, 3.0],
            "period_s": 30.0,
            "direction": "ccw",
        }
    )
    assert isinstance(other, ShapeGoal)
    assert other.rate_rad_s == pytest.approx(-2.0 * pi / 30.0)


@pytest.mark.parametrize(
    ("heading", "expected"),
    [
        ("fixed", FixedHeading()),
        ("target", TargetHeading()),
        ("velocity", VelocityHeading()),
        ({"point": [1.0, 2.0, 3.0]}, PointHeading((2.0, 1.0, -3.0))),
    ],
)
def test_headings_by_name_and_by_point_in_the_frame(heading: Any, expected: object) -> None:
    circle = {"kind": "circle", "frame": "local_enu", "center": [0.0, 0.0, 10.0], "radius_m": 3.0, "speed_m_s": 0.5}
    goal = goal_of(trajectory=circle | {"heading": heading})
    assert isinstance(goal, ShapeGoal) and goal.heading == expected


def test_polynomials_holds_and_streams() -> None:
    pushed = goal_of(trajectory={"kind": "polynomial", "jerk_m_s3": [1.0, 0.0, -0.5], "duration_s": 0.8})
    assert isinstance(pushed, PolynomialGoal)
    assert (pushed.jerk_ned_m_s3, pushed.duration_s) == ((1.0, 0.0, -0.5), 0.8)
    held = goal_of(trajectory={"kind": "hold", "duration_s": 4.0})
    assert isinstance(held, HoldGoal) and held.duration_s == 4.0
    stream = goal_of(stream={"timeout_s": 0.7})
    assert isinstance(stream, StreamGoal) and stream.timeout_s == 0.7


def circle(**changes: Any) -> dict[str, Any]:
    given = {"kind": "circle", "center": [0.0, 0.0, -10.0], "radius_m": 5.0, "speed_m_s": 1.0}
    return {"trajectory": given | changes}


@pytest.mark.parametrize(
    ("params", "field", "words"),
    [
        ({"waypoint": {"position": [0.0, 0.0, -60.0]}}, "waypoint.position[2]", "ceiling"),
        ({"waypoint": {"position": [0.0, 0.0, -0.5]}}, "waypoint.position[2]", "floor"),
        ({"waypoint": {"position": [-20.0, -98.0, -10.0]}}, "waypoint.position", "m away; at most 90 m"),
        ({"waypoint": {"position": [-80.0, 40.0, -60.0]}}, "waypoint.position", "at most 90 m"),
        ({"waypoint": {"position": [1.0, 1.0, -9.0], "hold_s": 9000.0}}, "waypoint.hold_s", "not within 0 to 3600"),
        (
            {"path": {"waypoints": [{"position": [1.0, 1.0, -9.0]}, {"position": [1.0, 1.0, -70.0]}]}},
            "path.waypoints[1].position[2]",
            "ceiling",
        ),
        (circle(speed_m_s=6.0, radius_m=40.0), "trajectory.speed_m_s", "m/s is more than"),
        (circle(speed_m_s=4.5), "trajectory.speed_m_s", "m/s^2 is more than"),
        (circle(center=[0.0, 0.0, -48.0], axis=[1.0, 0.0, 0.0]), "trajectory", "ceiling"),
        (
            {"trajectory": {"kind": "polynomial", "jerk_m_s3": [30.0, 0.0, 0.0], "duration_s": 0.2}},
            "trajectory.jerk_m_s3",
            "m/s^3",
        ),
        (
            {"trajectory": {"kind": "polynomial", "jerk_m_s3": [3.0, 0.0, 0.0], "duration_s": 3.0}},
            "trajectory.jerk_m_s3",
            "after some time",
        ),
        ({"trajectory": {"kind": "hold", "duration_s": 4000.0}}, "trajectory.duration_s", "not within"),
        ({"stream": {"timeout_s": 4000.0}}, "stream.timeout_s", "not within"),
    ],
)
def test_what_cannot_be_flown_is_refused_with_its_field(params: dict[str, Any], field: str, words: str) -> None:
    error = refusal_of(**params)
    assert error.code is ErrorCode.REFUSED
    assert error.field is not None and error.field.startswith(field), error
    assert words in error.reason


def test_a_start_that_cannot_stop_inside_the_fence_is_refused_for_its_way() -> None:
    fast = Reference(7.0, (96.0, 0.0, -10.0), (5.0, 0.0, 0.0))
    error = refusal_of(replace(PLACE, flown=fast), waypoint={"position": [90.0, 0.0, -10.0]})
    assert error.field == "waypoint.position[0]"
    assert error.reason.startswith("on the way: ")


def test_a_moved_goal_keeps_id_limits_time_out_and_is_checked() -> None:
    old = order_of(waypoint={"position": [1.0, 1.0, -9.0]}, limits={"speed_m_s": 1.0}, timeout_s=20.0)
    moved = orders.moved(old, Waypoint(position=(4.0, 0.0, -9.0)), PLACE)
    assert (moved.goal_id, moved.limits, moved.timeout_s, moved.connection) == ("g1", old.limits, 20.0, 4)
    assert isinstance(moved.goal, WaypointGoal) and moved.goal.position_ned_m == (4.0, 0.0, -9.0)
    with pytest.raises(ProtocolError) as error:
        orders.moved(old, Waypoint(position=(4.0, 0.0, -90.0)), PLACE)
    assert error.value.field == "waypoint.position[2]"


def test_a_long_check_runs_beside_the_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    async def main() -> list[str]:
        loop, ran = asyncio.get_running_loop(), list[str]()
        beside = loop.run_in_executor

        def noting(executor: None, work: Any, *args: Any) -> "asyncio.Future[Any]":
            ran.append("beside")
            return beside(executor, work, *args)

        monkeypatch.setattr(loop, "run_in_executor", noting)
        for through in ("stop", "fly_by"):
            path = {"waypoints": [{"position": [4.0, 4.0, -10.0]}], "through": through}
            await orders.order("g1", GoalSubmit.model_validate({"path": path}), PLACE, 4)
            ran.append(through)
        return ran

    assert run_virtual(main()) == ["stop", "beside", "fly_by"]


def sample(**changes: Any) -> ReferenceSet:
    given = {"goal_id": "g1", "position": [1.0, 2.0, -9.0], "velocity": [0.5, 0.0, 0.0]}
    return ReferenceSet.model_validate(given | changes)


def test_a_streamed_reference_without_a_stamp_is_of_now() -> None:
    found = orders.stream_sample(sample(yaw_deg=90.0, yaw_rate_deg_s=-10.0, acceleration=[0.1, 0.0, 0.0]), 50.0)
    assert (found.stamp_s, found.position_ned_m, found.velocity_ned_m_s) == (50.0, (1.0, 2.0, -9.0), (0.5, 0.0, 0.0))
    assert found.yaw_rad == pytest.approx(pi / 2)
    assert found.yaw_rate_rad_s == pytest.approx(radians(-10.0))
    assert (found.acceleration_ned_m_s2, found.jerk_ned_m_s3) == ((0.1, 0.0, 0.0), None)
    assert orders.stream_sample(sample(stamp_s=49.9), 50.0).stamp_s == 49.9
    assert orders.stream_sample(sample(), 50.0).yaw_rad is None


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({}, None),
        ({"stamp_s": 49.0}, None),
        ({"stamp_s": 48.9}, "stamp_s"),
        ({"stamp_s": 50.6}, "stamp_s"),
        ({"position": [0.0, 0.0, -60.0]}, "position[2]"),
        ({"position": [0.0, 120.0, -10.0]}, "position[1]"),
        ({"velocity": [6.0, 0.0, 0.0]}, "velocity"),
        ({"velocity": [0.0, 0.0, 4.0]}, "velocity[2]"),
        ({"acceleration": [0.0, 5.0, 0.0]}, "acceleration"),
    ],
)
def test_a_streamed_reference_is_refused_by_field(changes: dict[str, Any], field: str | None) -> None:
    found = orders.stream_refusal(orders.stream_sample(sample(**changes), 50.0), None, LIMITS, FENCE, 50.0)
    assert (None if found is None else found.field) == field


def test_a_pose_from_outside() -> None:
    given = {"position": [1.0, 2.0, 3.0], "orientation": [2.0**0.5 / 2, 0.0, 0.0, 2.0**0.5 / 2]}
    plain = orders.external_pose(EstimatorPose.model_validate(given), 50.0)
    assert (plain.stamp_s, plain.position_variance_m2, plain.angle_variance_rad2) == (50.0, None, None)
    assert plain.attitude_wb is not None and yaw_of(plain.attitude_wb) == pytest.approx(pi / 2)
    known = given | {"covariance": [0.1, 0.2, 0.3, 0.4, 0.5, 0.6], "stamp_s": 49.5}
    found = orders.external_pose(EstimatorPose.model_validate(known), 50.0)
    assert found.stamp_s == 49.5
    assert (found.position_variance_m2, found.angle_variance_rad2) == ((0.1, 0.2, 0.3), (0.4, 0.5, 0.6))
