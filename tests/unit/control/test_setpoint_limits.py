"""Whatever comes in, the setpoint is finite and within its limits, and what was refused or cut is named."""

from dataclasses import fields, replace
from math import hypot, inf, isfinite, nan, radians
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.controller_rig import DT, HERE, P, at, flown

from daemon import frames
from daemon.control import controller
from daemon.control.parameters import AttitudeLaw, ControlParameters, mavros_controllers
from daemon.messages import ZERO3, EstimatedState, Reference, Reset, Setpoint, Vec3

mad = st.one_of(st.floats(-20.0, 20.0), st.sampled_from([0.0, nan, inf, -inf, 1e300, -1e300, 1e-320, 1e7]))
mad_vectors = st.tuples(mad, mad, mad)
wild_vectors = st.tuples(*[st.floats(-300.0, 300.0)] * 3)
wild_states = st.builds(
    EstimatedState,
    time_s=st.floats(0.0, 1.0),
    position_ned_m=wild_vectors,
    velocity_ned_m_s=wild_vectors,
    attitude_wb=st.tuples(*[st.floats(-3.0, 3.0)] * 3).map(frames.exp),
    rates_frd_rad_s=wild_vectors,
)
wild_references = st.builds(
    Reference,
    time_s=st.floats(0.0, 1.0),
    position_ned_m=wild_vectors,
    velocity_ned_m_s=wild_vectors,
    acceleration_ned_m_s2=wild_vectors,
    jerk_ned_m_s3=wild_vectors,
    yaw_rad=st.floats(-10.0, 10.0),
    yaw_rate_rad_s=st.floats(-300.0, 300.0),
)


@st.composite
def mad_of(draw: st.DrawFn, wild: st.SearchStrategy[Any]) -> Any:
    """A wild but finite message in which up to two fields are mad."""
    message = draw(wild)
    names = draw(st.sets(st.sampled_from([f.name for f in fields(message)]), max_size=2))
    for name in names:
        value = getattr(message, name)
        bad = draw(st.tuples(*[mad] * len(value)) if isinstance(value, tuple) else mad)
        message = replace(message, **{name: bad})
    return message


mad_states, mad_references = mad_of(wild_states), mad_of(wild_references)
mad_resets = st.builds(
    Reset, time_s=mad, kinds=st.just(frozenset()), position_ned_m=mad_vectors, velocity_ned_m_s=mad_vectors, yaw_rad=mad
)
variants = st.sampled_from(
    [
        P,
        replace(P, attitude_law=AttitudeLaw.GEOMETRIC, thrust_curve=0.7),
        replace(P, attitude_law=AttitudeLaw.JERK, drag_1_s=(0.3, 0.2, 0.1)),
        replace(mavros_controllers(), thrust_max=0.9),
        replace(P, rate_lag_s=ZERO3, thrust_lag_s=0.0, hover_thrust=0.95, hover_range=0.9),
    ]
)


def assert_within_limits(setpoint: Setpoint, p: ControlParameters) -> None:
    x, y, z = setpoint.rates_frd_rad_s
    assert all(isfinite(v) for v in (x, y, z, setpoint.thrust))
    assert hypot(x, y) <= p.rate_max_rad_s * (1.0 + 1e-12) and abs(z) <= p.yaw_rate_max_rad_s
    assert p.thrust_min <= setpoint.thrust <= p.thrust_max


@given(variants, st.lists(st.tuples(mad_states, mad_states, mad_references, mad, st.none() | mad_resets), max_size=5))
@settings(deadline=None, max_examples=200)
def test_no_input_makes_a_setpoint_that_is_not_finite_or_not_within_limits(
    p: ControlParameters,
    inputs: list[tuple[EstimatedState, EstimatedState, Reference, float, Reset | None]],
) -> None:
    state = controller.initial(p)
    for estimate, predicted, reference, dt_s, reset in inputs:
        assert_within_limits(controller.match(state, estimate, parameters=p), p)
        assert_within_limits(controller.level(state, predicted, parameters=p), p)
        if reset is not None:
            state = controller.shifted(state, reset)
        state, setpoint, record = controller.step(state, estimate, predicted, reference, dt_s, parameters=p)
        assert_within_limits(setpoint, p)
        assert all(isfinite(v) for v in (*record.disturbance_ned_m_s2, *record.acceleration_ned_m_s2))
    # and a sane vehicle is flown again at once
    now = at(1e4)
    _, setpoint, record = controller.step(state, now, now, Reference(1e4, HERE), DT, parameters=p)
    assert record.refused == ()
    assert setpoint.rates_frd_rad_s == pytest.approx(ZERO3, abs=1e-9)


def test_bad_inputs_are_named() -> None:
    good, bad = at(1.0), at(1.0, position=(nan, 0.0, 0.0))
    reference, far = Reference(1.0, HERE), Reference(1.0, HERE, jerk_ned_m_s3=(inf, 0.0, 0.0))
    state = controller.initial(P)
    for estimate, predicted, wanted, names in (
        (bad, good, reference, ("estimate",)),
        (good, bad, reference, ("predicted",)),
        (good, good, far, ("reference",)),
        (bad, bad, far, ("estimate", "predicted", "reference")),
        (good, at(1.0, attitude=(0.0, 0.0, 0.0, 0.0)), reference, ("predicted",)),
    ):
        assert controller.step(state, estimate, predicted, wanted, DT, parameters=P)[2].refused == names


@pytest.mark.parametrize("time_s", [nan, 1.0])
def test_bad_estimate_does_not_stop_the_law_from_flying_on_the_prediction(time_s: float) -> None:
    bad, good = at(time_s, velocity=(nan, 0.0, 0.0)), at(1.02, position=(2.5, -2.0, -10.0))
    _, setpoint, _ = controller.step(controller.initial(P), bad, good, Reference(1.02, HERE), DT, parameters=P)
    assert setpoint.rates_frd_rad_s[1] < -0.1


def test_without_a_reference_the_vehicle_is_levelled() -> None:
    tilted = at(1.0, attitude=frames.from_rpy(0.3, 0.0, 1.0))
    _, setpoint, _ = controller.step(
        controller.initial(P), tilted, tilted, Reference(nan, HERE, yaw_rad=nan), DT, parameters=P
    )
    assert setpoint.rates_frd_rad_s[0] < -0.5
    assert setpoint.rates_frd_rad_s[2] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    "other",
    [
        replace(P, attitude_law=AttitudeLaw.JERK),
        replace(P, attitude_law=AttitudeLaw.GEOMETRIC, original_gain=True),
        replace(P, position_gain_1_s2=(20.0, 20.0, 20.0), velocity_gain_1_s=(9.0, 9.0, 9.0)),
        replace(P, disturbance_bandwidth_rad_s=0.0, rate_feed_forward=False),
        replace(P, attitude_time_constant_s=(0.05, 0.05, 0.2)),
    ],
)
def test_switching_law_or_gains_in_flight_stays_within_slew(other: ControlParameters) -> None:
    off = (2.6, -1.7, -9.8)
    state, before = flown(controller.initial(P), 50, position=off)
    for _ in range(20):
        state, after = flown(state, 1, other, position=off)
        (ax, ay, az), (bx, by, bz) = after.rates_frd_rad_s, before.rates_frd_rad_s
        assert hypot(ax - bx, ay - by) <= P.rate_slew_max_rad_s2 * DT + 1e-9
        assert abs(az - bz) <= P.rate_slew_max_rad_s2 * DT + 1e-9
        assert abs(after.thrust - before.thrust) <= P.thrust_slew_max_1_s * DT + 1e-9
        before = after


@pytest.mark.parametrize("bad", [nan, inf, -inf])
def test_state_without_a_time_is_refused(bad: float) -> None:
    state = controller.initial(P)
    _, _, record = controller.step(state, at(1.0), at(bad), Reference(1.0, HERE), DT, parameters=P)
    assert record.refused == ("predicted",)


FREE = replace(P, rate_slew_max_rad_s2=9999.0, thrust_slew_max_1_s=999.0, tilt_max_rad=radians(80.0))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_each_limit_is_named_when_it_cuts_and_only_then(sign: float) -> None:
    def names(offset: Vec3, p: ControlParameters) -> tuple[str, ...]:
        _, hovering = flown(controller.initial(p), 1, p)
        state = replace(controller.initial(p), time_s=0.9, setpoint=hovering)
        now = at(1.0, frames.add(HERE, frames.scale(offset, sign)))
        return controller.step(state, now, now, Reference(1.0, HERE), DT, parameters=p)[2].limited

    assert names((0.05, 0.02, 0.03), FREE) == ()
    assert names((0.5, 0.3, 0.0), replace(FREE, rate_max_rad_s=0.1)) == ("rates",)
    first = "thrust_vector" if sign > 0.0 else "thrust"  # upwards, all of the thrust is in the vector already
    assert names((0.0, 0.0, 0.5), replace(FREE, thrust_min=0.49, thrust_max=0.51))[0] == first
    assert names(ZERO3, replace(FREE, linear_thrust=(0.05, 0.1), thrust_max=0.55))[-1] == "thrust"
    assert names((0.5, 0.3, 0.0), replace(FREE, rate_slew_max_rad_s2=1.0)) == ("slew",)
    assert names((0.0, 0.0, 0.5), replace(FREE, thrust_slew_max_1_s=0.1)) == ("slew",)
    assert names((3.0, 2.0, 0.0), replace(FREE, tilt_max_rad=radians(10.0))) == ("thrust_vector",)
