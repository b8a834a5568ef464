"""The flow as a whole: no input, however mad, makes it raise or send what is not finite and within limits."""

from dataclasses import replace
from math import inf, isfinite, nan, pi

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support.pipeline_rig import DT_S, ENGAGE, PARAMETERS, Flow, odometry, window_of
from support.statuses import IN_HOLD, IN_OFFBOARD

from daemon import pipeline
from daemon.messages import (
    WINDOW_SPACING_S,
    FrameShift,
    Imu,
    Reference,
    ReferenceWindow,
    RequestKind,
    Setpoint,
    VehicleRequest,
)
from daemon.pipeline import Inputs
from daemon.safety.supervisor import FLYING, State


def within_limits(setpoint: Setpoint) -> bool:
    p = PARAMETERS.control
    roll, pitch, yaw = setpoint.rates_frd_rad_s
    return (
        all(isfinite(v) for v in (roll, pitch, yaw, setpoint.thrust))
        and roll * roll + pitch * pitch <= p.rate_max_rad_s**2 * (1 + 1e-9)
        and abs(yaw) <= p.yaw_rate_max_rad_s * (1 + 1e-9)
        and p.thrust_min - 1e-9 <= setpoint.thrust <= p.thrust_max + 1e-9
    )


numbers = st.one_of(
    st.sampled_from([nan, inf, -inf, 0.0, 1e-300, 1e300, -1e300, 1e9, 1.0]), st.floats(-50.0, 50.0, allow_nan=False)
)
vectors = st.tuples(numbers, numbers, numbers)
quaternions = st.tuples(numbers, numbers, numbers, numbers)
mad_samples = st.fixed_dictionaries(
    {},
    optional={
        "stamp_us": st.integers(-(10**12), 10**15),
        "frame_id": st.integers(0, 30),
        "child_frame_id": st.sampled_from([0, 1, 8, 12, 20, 99]),
        "position_m": vectors,
        "velocity_m_s": vectors,
        "attitude_wb": quaternions,
        "rates_frd_rad_s": vectors,
        "position_variance_m2": vectors,
        "reset_counter": st.integers(0, 255),
    },
)
mad_windows = st.lists(st.tuples(vectors, vectors, vectors, vectors, numbers, numbers), min_size=1, max_size=8)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(samples=st.lists(mad_samples, min_size=1, max_size=30), points=mad_windows, forces=st.lists(vectors, max_size=5))
def test_no_input_however_mad_makes_the_flow_raise_or_leave_its_limits(
    samples: list[dict[str, object]], points: list[tuple[object, ...]], forces: list[tuple[float, float, float]]
) -> None:
    flow = Flow().flying()
    for i, changes in enumerate(samples):
        if i % 3 == 0:
            references = tuple(
                Reference(flow.now_s + 0.02 + WINDOW_SPACING_S * k, *point)  # type: ignore[arg-type]
                for k, point in enumerate(points)
            )
            flow.window = ReferenceWindow("mad", references, FrameShift())
        imu = Imu(i, flow.now_s, forces[i % len(forces)], (nan, 0.0, 1e9), (0.0, inf, 0.0)) if forces else None
        setpoint, _ = flow.tick(odometry(flow.n + 1, **changes), imu)
        assert setpoint is None or within_limits(setpoint)


def test_nothing_leaves_while_the_vehicle_is_not_ours() -> None:
    flow = Flow()
    for _ in range(50):
        setpoint, record = flow.tick()
        assert setpoint is None
        assert record.modes == ()
    assert record.supervision.state is State.PILOT


def test_the_reference_at_takeover_is_the_vehicle_as_it_is() -> None:
    flow = Flow()
    drifting = {"velocity_m_s": (0.3, 0.0, 0.0), "attitude_wb": (0.9238795325112867, 0.0, 0.0, 0.3826834323650898)}
    for i in range(51):
        flow.request = ENGAGE if i >= 20 else None
        flow.tick(odometry(flow.n + 1, (0.003 * i, 0.0, -5.0), **drifting))
    flow.status = IN_OFFBOARD
    _, record = flow.tick(odometry(flow.n + 1, (0.003 * 51, 0.0, -5.0), **drifting))
    assert record.supervision.state in FLYING
    assert record.reference is not None
    assert record.reference.velocity_ned_m_s[0] == pytest.approx(0.3, abs=0.05)
    assert record.reference.yaw_rad == pytest.approx(pi / 4, abs=0.01)


def test_the_fence_moves_with_a_reset() -> None:
    parameters = replace(
        PARAMETERS, bounds=replace(PARAMETERS.bounds, fence=replace(PARAMETERS.bounds.fence, radius_m=10.0))
    )
    flow = Flow().flying()
    n = flow.n
    for i in range(30):
        flow.n += 1
        sample = odometry(flow.n, (0.0 if i < 5 else 18.0, 0.0, -5.0), reset_counter=11 if i < 5 else 13)
        inputs = Inputs(sample, None, IN_OFFBOARD, None, ENGAGE, False, parameters)
        flow.state, _, record = pipeline.step(flow.state, inputs, flow.now_s, DT_S)
    assert flow.n > n
    assert record.supervision.state is State.HOLDING


def test_the_fence_stays_when_the_truth_returns() -> None:
    """80 m at once is the truth, and outside of a fence of 10 m."""
    parameters = replace(
        PARAMETERS, bounds=replace(PARAMETERS.bounds, fence=replace(PARAMETERS.bounds.fence, radius_m=10.0))
    )
    flow = Flow()
    for i in range(10):
        flow.n += 1
        sample = odometry(flow.n, (0.0 if i < 5 else 80.0, 0.0, -5.0), reset_counter=11 if i < 5 else 13)
        inputs = Inputs(sample, None, IN_HOLD, None, None, False, parameters)
        flow.state, _, record = pipeline.step(flow.state, inputs, flow.now_s, DT_S)
        assert record.conditions.fence_breached is (i >= 5)


def test_the_fence_is_where_its_anchor_was_plus_the_resets_since() -> None:
    """A fence of 10 m whose anchor was computed under a shift of (20, 0, 0); the jump of 3 m north came after."""
    for position_n, inside in ((-17.0 + 9.0, True), (-17.0 - 9.0, True), (-17.0 + 16.0, False), (-17.0 - 16.0, False)):
        fence = replace(PARAMETERS.bounds.fence, anchor_ned_m=(0.0, 0.0, 0.0), radius_m=10.0, hard_margin_m=5.0)
        parameters = replace(
            PARAMETERS,
            bounds=replace(PARAMETERS.bounds, fence=fence),
            fence_shift=FrameShift(7, 0.0, (30.0, 0.0, 0.0), origin_ned_m=(20.0, 0.0, 0.0)),
        )
        flow = Flow()
        for i in range(10):
            flow.n += 1
            sample = odometry(
                flow.n, (position_n + (-3.0 if i < 5 else 0.0), 0.0, -5.0), reset_counter=11 if i < 5 else 13
            )
            inputs = Inputs(sample, None, IN_HOLD, None, None, False, parameters)
            flow.state, _, record = pipeline.step(flow.state, inputs, flow.now_s, DT_S)
        assert record.estimate.shift.position_ned_m[0] == pytest.approx(3.0, abs=0.02)
        assert record.conditions.fence_breached is not inside


def test_a_vehicle_that_its_reference_leaves_behind_is_handed_over() -> None:
    flow = Flow().flying()
    _, record = flow.tick()
    assert record.reference is not None
    flow.window = window_of(record.reference, (5.0, 0.0, 0.0), 300)
    begin = flow.n
    while record.supervision.state is not State.RELEASING:
        _, record = flow.tick()
    assert record.supervision.left == "not_followed"
    assert (flow.n - begin) * DT_S == pytest.approx(4.0 / 5.0 + 3.0, abs=0.1)


def test_a_reset_leaves_no_vehicle_behind() -> None:
    flow = Flow().flying()
    for _ in range(400):
        _, record = flow.tick(odometry(flow.n + 1, (18.0, 0.0, -5.0), reset_counter=13))
    assert record.estimate.shift.count == 1
    assert record.supervision.state is State.HOLDING


def test_levelling_ends_with_the_horizon_of_the_prediction_in_zero_rates() -> None:
    flow = Flow().flying()
    tilted = {"attitude_wb": (0.9950041652780258, 0.09983341664682815, 0.0, 0.0)}  # 0.2 rad to the right
    for _ in range(10):
        flow.tick(odometry(flow.n + 1, **tilted))
    last = odometry(flow.n, **tilted)
    rolled = []
    for i in range(70):
        setpoint, record = flow.tick(last)
        if i == 15:
            assert record.drive.value == "law" and record.control is not None
        if i > 25:
            assert record.drive.value == "level" and record.control is None, "the law has no say"
        rolled.append(setpoint)
    assert all(setpoint is not None for setpoint in rolled)
    assert rolled[30] is not None and rolled[30].rates_frd_rad_s != (0.0, 0.0, 0.0)
    assert rolled[-1] is not None and rolled[-1].rates_frd_rad_s == (0.0, 0.0, 0.0)
    assert rolled[-1].thrust == pytest.approx(PARAMETERS.control.hover_thrust, abs=0.05)


def test_only_a_goal_is_tracked_and_a_shut_gate_ends_it() -> None:
    flow = Flow().flying()
    assert flow.state.flown is not None
    flow.window = replace(window_of(flow.state.flown, (0.0, 0.0, 0.0)), goal_id=None)
    assert flow.tick()[1].supervision.state is State.HOLDING
    flow.window = window_of(flow.state.flown, (0.0, 0.0, 0.0))
    assert flow.tick()[1].supervision.state is State.TRACKING
    inputs = Inputs(odometry(flow.n + 1), None, IN_OFFBOARD, flow.window, ENGAGE, True, PARAMETERS)
    _, setpoint, record = pipeline.step(flow.state, inputs, flow.now_s + DT_S, DT_S)
    assert record.supervision.state is State.FAULT
    assert setpoint is None and record.reference is None and record.control is None


def test_what_was_learned_of_a_flight_before_is_forgotten_at_the_next_engage() -> None:
    flow = Flow().flying()
    assert flow.state.flown is not None
    higher = replace(flow.state.flown, position_ned_m=(0.0, 0.0, -5.3))
    flow.window = window_of(higher, (0.0, 0.0, 0.0), 400)
    for _ in range(300):  # it thrusts, and yet it does not climb
        flow.tick()
    assert flow.state.control.hover_thrust > PARAMETERS.control.hover_thrust + 0.01
    flow.status = IN_HOLD
    flow.request = None
    for _ in range(50):
        setpoint, record = flow.tick()
        assert setpoint is None
    assert flow.state.flown is None and flow.state.sent == ()
    flow.request = VehicleRequest(2, RequestKind.HOLD)
    flow.tick()
    flow.tick()
    flow.request = VehicleRequest(3, RequestKind.ENGAGE)
    setpoint, record = flow.tick()
    assert record.supervision.state is State.ENGAGING
    assert setpoint is not None
    assert setpoint.thrust == pytest.approx(PARAMETERS.control.hover_thrust)
    assert setpoint.rates_frd_rad_s == (0.0, 0.0, 0.0)


def test_the_record_says_when_and_for_which_moment() -> None:
    flow = Flow().flying()
    setpoint, record = flow.tick()
    assert (record.now_s, record.dt_s) == (flow.now_s, DT_S)
    assert record.predicted is not None and record.reference is not None
    assert record.predicted.time_s == pytest.approx(flow.now_s + PARAMETERS.command_latency_s)
    assert record.reference.time_s == pytest.approx(flow.now_s + PARAMETERS.command_latency_s)
    assert record.setpoint is setpoint
