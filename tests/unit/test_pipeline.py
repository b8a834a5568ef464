"""The flow as a whole: no input, however mad, makes it raise or send what is not finite and within limits."""

from dataclasses import replace
from itertools import pairwise
from math import inf, isfinite, nan, pi

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from daemon import pipeline
from daemon.config import load
from daemon.messages import (
    WINDOW_SPACING_S,
    AutopilotStatus,
    FlightMode,
    FrameShift,
    Imu,
    LandedState,
    Odometry,
    Reference,
    ReferenceWindow,
    RequestKind,
    Setpoint,
    SystemStatus,
    VehicleRequest,
)
from daemon.parameters import geofence, pipeline_parameters
from daemon.pipeline import Inputs, PipelineState, Record
from daemon.safety.supervisor import FLYING, State

CONFIG = load([])
PARAMETERS = pipeline_parameters(CONFIG, geofence(CONFIG, (0.0, 0.0, 0.0)))
HOLD = AutopilotStatus(
    connected=True,
    mode=FlightMode.HOLD,
    intended_mode=FlightMode.HOLD,
    armed=True,
    landed=LandedState.IN_AIR,
    system_status=SystemStatus.ACTIVE,
)
OFFBOARD = replace(HOLD, mode=FlightMode.OFFBOARD, intended_mode=FlightMode.OFFBOARD)
DT_S = 0.01
ENGAGE = VehicleRequest(1, RequestKind.ENGAGE)


def odometry(n: int, position: tuple[float, float, float] = (0.0, 0.0, -5.0), **changes: object) -> Odometry:
    sample = Odometry(
        stamp_us=1_000_000 + 10_000 * n,
        arrival_s=DT_S * n,
        frame_id=1,
        child_frame_id=1,
        position_m=position,
        velocity_m_s=(0.0, 0.0, 0.0),
        attitude_wb=(1.0, 0.0, 0.0, 0.0),
        rates_frd_rad_s=(0.0, 0.0, 0.0),
        position_variance_m2=(0.04, 0.04, 0.04),
        velocity_variance_m2_s2=(0.01, 0.01, 0.01),
        reset_counter=11,
    )
    return replace(sample, **changes)  # type: ignore[arg-type]


class Flow:
    """Ticks the pipeline at 100 Hz."""

    def __init__(self) -> None:
        self.state: PipelineState = pipeline.initial(PARAMETERS)
        self.n = 0
        self.window: ReferenceWindow | None = None
        self.status = HOLD
        self.request: VehicleRequest | None = None

    @property
    def now_s(self) -> float:
        return DT_S * self.n

    def tick(self, sample: Odometry | None = None, imu: Imu | None = None) -> tuple[Setpoint | None, Record]:
        self.n += 1
        inputs = Inputs(
            odometry=odometry(self.n) if sample is None else sample,
            imu=imu,
            status=self.status,
            window=self.window,
            request=self.request,
            latched=False,
            parameters=PARAMETERS,
        )
        self.state, setpoint, record = pipeline.step(self.state, inputs, self.now_s, DT_S)
        return setpoint, record

    def flying(self) -> "Flow":
        for _ in range(20):
            self.tick()
        self.request = ENGAGE
        for _ in range(30):
            self.tick()
        self.status = OFFBOARD
        _, record = self.tick()
        assert record.supervision.state is State.HOLDING
        return self


def window_of(start: Reference, velocity: tuple[float, float, float], count: int = 60) -> ReferenceWindow:
    """Straight on with a velocity."""
    samples = []
    for i in range(count):
        t = i * WINDOW_SPACING_S
        position = tuple(p + v * t for p, v in zip(start.position_ned_m, velocity, strict=True))
        samples.append(Reference(start.time_s + t, position, velocity, yaw_rad=start.yaw_rad))  # type: ignore[arg-type]
    return ReferenceWindow("goal", tuple(samples), FrameShift())


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


def test_the_window_is_flown_where_it_covers_the_moment() -> None:
    flow = Flow().flying()
    start = flow.state.flown
    assert start is not None
    flow.window = window_of(start, (1.0, -0.5, 0.25))
    for _ in range(30):
        _, record = flow.tick()
        reference = record.reference
        assert reference is not None
        t = reference.time_s - start.time_s
        assert reference.position_ned_m == pytest.approx(
            tuple(p + v * t for p, v in zip(start.position_ned_m, (1.0, -0.5, 0.25), strict=True)), abs=1e-9
        )
        assert reference.time_s == pytest.approx(flow.now_s + PARAMETERS.command_latency_s)


def test_a_window_that_runs_out_is_braked_to_a_hover_within_the_limits() -> None:
    flow = Flow().flying()
    assert flow.state.flown is not None
    flow.window = window_of(flow.state.flown, (3.0, 0.0, 0.0), count=20)
    references = []
    for _ in range(400):
        _, record = flow.tick()
        assert record.reference is not None
        references.append(record.reference)
    speeds = [r.velocity_ned_m_s[0] for r in references]
    assert max(speeds) == pytest.approx(3.0)
    assert abs(speeds[-1]) < 1e-6
    steps = [abs(b - a) / DT_S for a, b in pairwise(speeds[25:])]
    assert max(steps) <= PARAMETERS.limits.acceleration_m_s2 * 1.01
    moved = references[-1].position_ned_m[0] - references[20].position_ned_m[0]
    assert 1.5 < moved < 4.0


def test_a_window_planned_before_a_reset_is_shifted_when_it_is_flown() -> None:
    flow = Flow().flying()
    assert flow.state.flown is not None
    flow.window = window_of(flow.state.flown, (0.0, 0.0, 0.0))
    _, before = flow.tick()
    _, after = flow.tick(odometry(flow.n + 1, (3.0, -4.0, -5.0), reset_counter=13))
    assert after.estimate.reset is not None
    assert before.reference is not None and after.reference is not None
    moved = tuple(b - a for a, b in zip(before.reference.position_ned_m, after.reference.position_ned_m, strict=True))
    assert moved == pytest.approx((3.0, -4.0, 0.0), abs=0.02)
    assert after.setpoint is not None
    assert max(abs(rate) for rate in after.setpoint.rates_frd_rad_s) < 0.1, "the vehicle must not lurch"


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
    flow.status = OFFBOARD
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
        inputs = Inputs(sample, None, OFFBOARD, None, ENGAGE, False, parameters)
        flow.state, _, record = pipeline.step(flow.state, inputs, flow.now_s, DT_S)
    assert flow.n > n
    assert record.supervision.state is State.HOLDING


def cubic(time_s: float) -> Reference:
    """A motion with every derivative, none like another, and a heading that runs past a half turn."""
    j, a, v, p = (30.0, -24.0, 18.0), (2.0, -3.0, 1.0), (0.5, 0.7, -0.3), (1.0, -2.0, -5.0)
    t = time_s
    return Reference(
        time_s,
        tuple(p[i] + v[i] * t + a[i] * t**2 / 2 + j[i] * t**3 / 6 for i in range(3)),  # type: ignore[arg-type]
        tuple(v[i] + a[i] * t + j[i] * t**2 / 2 for i in range(3)),  # type: ignore[arg-type]
        tuple(a[i] + j[i] * t for i in range(3)),  # type: ignore[arg-type]
        j,
        (3.1 + 2.0 * t + pi) % (2.0 * pi) - pi,
        2.0,
    )


def cubic_window(begin_s: float, count: int, shift: FrameShift | None = None) -> ReferenceWindow:
    """It runs from ``begin_s`` of the loop's clock, where its own time is zero."""
    samples = tuple(replace(cubic(i * WINDOW_SPACING_S), time_s=begin_s + i * WINDOW_SPACING_S) for i in range(count))
    return ReferenceWindow("goal", samples, shift or FrameShift())


def values(r: Reference) -> tuple[float, ...]:
    return (
        *r.position_ned_m,
        *r.velocity_ned_m_s,
        *r.acceleration_ned_m_s2,
        *r.jerk_ned_m_s3,
        r.yaw_rad,
        r.yaw_rate_rad_s,
    )


@pytest.mark.parametrize("before_s", [0.0, 0.003, 0.0049, 0.0051, 0.008])
def test_between_its_samples_a_window_is_flown_by_its_derivatives(before_s: float) -> None:
    flow = Flow().flying()
    begin_s = flow.now_s + DT_S + PARAMETERS.command_latency_s - before_s
    flow.window = cubic_window(begin_s, 60)
    for _ in range(10):
        _, record = flow.tick()
        assert record.reference is not None
        assert values(record.reference) == pytest.approx(values(cubic(record.reference.time_s - begin_s)), abs=1e-9)


def test_a_window_reaches_a_spacing_beyond_its_last_sample() -> None:
    for after_s, covered in ((0.0, True), (0.009, True), (0.011, False)):
        flow = Flow().flying()
        act_s = flow.now_s + DT_S + PARAMETERS.command_latency_s
        begin_s = act_s - after_s - 9 * WINDOW_SPACING_S
        flow.window = cubic_window(begin_s, 10)
        _, record = flow.tick()
        assert record.reference is not None
        there = values(record.reference) == pytest.approx(values(cubic(act_s - begin_s)), abs=1e-9)
        assert there is covered


def test_a_window_that_begins_later_is_not_flown_yet() -> None:
    flow = Flow().flying()
    before = flow.state.flown
    assert before is not None
    flow.window = cubic_window(flow.now_s + DT_S + PARAMETERS.command_latency_s + 0.002, 60)
    _, record = flow.tick()
    assert record.reference is not None
    assert record.reference.position_ned_m == pytest.approx(before.position_ned_m, abs=1e-6)


def test_a_window_of_another_frame_is_turned_shifted_and_carried_on_with_the_velocity_since() -> None:
    flow = Flow().flying()
    flow.tick(odometry(flow.n + 1, (3.0, -4.0, -5.0), reset_counter=13))
    shift = flow.tick(odometry(flow.n + 1, (3.0, -4.0, -5.0), reset_counter=13))[1].estimate.shift
    assert shift.count == 1
    assert shift.position_ned_m == pytest.approx((3.0, -4.0, 0.0), abs=0.02)
    planned = FrameShift(0, shift.time_s, (1.0, 2.0, 3.0), (0.1, -0.2, 0.3), 0.4)
    begin_s = flow.now_s + DT_S + PARAMETERS.command_latency_s
    flow.window = cubic_window(begin_s, 60, planned)
    for _ in range(5):
        _, record = flow.tick(odometry(flow.n + 1, (3.0, -4.0, -5.0), reset_counter=13))
    assert record.reference is not None
    t = record.reference.time_s
    plain, since = cubic(t - begin_s), t - shift.time_s
    assert 0.05 < since < 0.2
    dp = tuple(now - then for now, then in zip(shift.position_ned_m, (1.0, 2.0, 3.0), strict=True))
    dv = tuple(now - then for now, then in zip(shift.velocity_ned_m_s, (0.1, -0.2, 0.3), strict=True))
    expected = tuple(p + d + v * since for p, d, v in zip(plain.position_ned_m, dp, dv, strict=True))
    assert record.reference.position_ned_m == pytest.approx(expected, abs=1e-9)
    assert record.reference.velocity_ned_m_s == pytest.approx(
        tuple(v + d for v, d in zip(plain.velocity_ned_m_s, dv, strict=True)), abs=1e-9
    )
    assert record.reference.yaw_rad == pytest.approx(
        (plain.yaw_rad + shift.yaw_rad - 0.4 + pi) % (2 * pi) - pi, abs=1e-9
    )


def test_a_hover_without_a_window_moves_with_a_reset() -> None:
    flow = Flow().flying()
    _, before = flow.tick()
    _, after = flow.tick(odometry(flow.n + 1, (3.0, -4.0, -6.0), reset_counter=13))
    assert before.reference is not None and after.reference is not None
    moved = tuple(b - a for a, b in zip(before.reference.position_ned_m, after.reference.position_ned_m, strict=True))
    assert moved == pytest.approx((3.0, -4.0, -1.0), abs=0.02)


def test_the_fence_is_where_its_anchor_was_plus_the_resets_since() -> None:
    """A fence of 10 m whose anchor was computed under a shift of (20, 0, 0); the jump of 3 m north came after."""
    for position_n, inside in ((-17.0 + 9.0, True), (-17.0 - 9.0, True), (-17.0 + 16.0, False), (-17.0 - 16.0, False)):
        fence = replace(PARAMETERS.bounds.fence, anchor_ned_m=(0.0, 0.0, 0.0), radius_m=10.0, hard_margin_m=5.0)
        parameters = replace(
            PARAMETERS,
            bounds=replace(PARAMETERS.bounds, fence=fence),
            fence_shift=FrameShift(7, 0.0, (20.0, 0.0, 0.0)),
        )
        flow = Flow()
        for i in range(10):
            flow.n += 1
            sample = odometry(
                flow.n, (position_n + (-3.0 if i < 5 else 0.0), 0.0, -5.0), reset_counter=11 if i < 5 else 13
            )
            inputs = Inputs(sample, None, HOLD, None, None, False, parameters)
            flow.state, _, record = pipeline.step(flow.state, inputs, flow.now_s, DT_S)
        assert record.estimate.shift.position_ned_m[0] == pytest.approx(3.0, abs=0.02)
        assert record.conditions.fence_breached is not inside


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
    inputs = Inputs(odometry(flow.n + 1), None, OFFBOARD, flow.window, ENGAGE, True, PARAMETERS)
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
    flow.status = HOLD
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
