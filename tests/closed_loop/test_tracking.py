"""The law around the simulated PX4 vehicle: each test is a sentence with a bound."""

from dataclasses import replace
from math import atan2, cos, pi, radians, sin

import pytest

from daemon import frames
from daemon.control.parameters import AttitudeLaw, ControlParameters, from_airframe
from daemon.messages import Reference, Vec3
from tests.closed_loop.tracking import (
    HOVER_HEIGHT_M,
    SIH_DRAG_1_S,
    Flight,
    RecordedErrors,
    hover,
    lemniscate,
    move,
    rms,
    tilt_max_rad,
)

DEFAULT = ControlParameters(drag_1_s=SIH_DRAG_1_S)
FAST = replace(DEFAULT, tilt_max_rad=radians(60.0))
RUN_IN_S = 6.0


def gust(t: float) -> Vec3:
    return (5.0, 0.0, 0.0) if t > 4.0 else (0.0, 0.0, 0.0)


def lap_s(peak_m_s: float) -> float:
    return RUN_IN_S + min(2.0 * pi * 14.142 / peak_m_s, 20.0)


@pytest.mark.parametrize(("peak_m_s", "bound_m"), [(2.0, 0.02), (5.0, 0.04), (8.0, 0.06)])
def test_lemniscate_without_noise(peak_m_s: float, bound_m: float) -> None:
    samples = Flight(reference_at=lemniscate(peak_m_s), parameters=FAST).fly(lap_s(peak_m_s))
    assert rms([s.error_m for s in samples if s.time_s > RUN_IN_S]) < 0.5 * bound_m
    assert tilt_max_rad(samples) < FAST.tilt_max_rad


@pytest.mark.parametrize(("peak_m_s", "bound_m"), [(2.0, 0.02), (5.0, 0.04), (8.0, 0.06)])
@pytest.mark.parametrize("wind", [(0.0, 0.0, 0.0), (4.0, 3.0, 0.0)], ids=["calm", "wind"])
def test_lemniscate_with_a_drag_that_nobody_configured(peak_m_s: float, bound_m: float, wind: Vec3) -> None:
    unknown = replace(FAST, drag_1_s=(0.0, 0.0, 0.0))
    flight = Flight(reference_at=lemniscate(peak_m_s), parameters=unknown, wind_at=lambda _: wind)
    late = [s for s in flight.fly(2.0 * lap_s(peak_m_s)) if s.time_s > lap_s(peak_m_s)]
    assert rms([s.error_m for s in late]) < 0.6 * bound_m
    assert late[-1].record.drag_learned_1_s == pytest.approx(1.0, abs=0.7 / peak_m_s)


@pytest.mark.parametrize(("peak_m_s", "bound_m"), [(2.0, 0.12), (5.0, 0.15), (8.0, 0.20)])
def test_lemniscate_with_the_recorded_errors_of_the_estimate(peak_m_s: float, bound_m: float) -> None:
    flight = Flight(reference_at=lemniscate(peak_m_s), parameters=FAST, errors=RecordedErrors())
    samples = [s for s in flight.fly(lap_s(peak_m_s)) if s.time_s > RUN_IN_S]
    assert rms([s.estimate_error_m for s in samples]) < 0.75 * bound_m
    assert tilt_max_rad(samples) < FAST.tilt_max_rad


@pytest.mark.parametrize("law", list(AttitudeLaw))
def test_each_attitude_law_flies(law: AttitudeLaw) -> None:
    samples = Flight(reference_at=lemniscate(5.0), parameters=replace(FAST, attitude_law=law)).fly(16.0)
    assert rms([s.error_m for s in samples if s.time_s > RUN_IN_S]) < 0.02


def test_wind_step_in_hover() -> None:
    samples = Flight(reference_at=hover, parameters=DEFAULT, wind_at=gust).fly(14.0)
    assert max(s.error_m for s in samples) < 0.5
    assert max(s.error_m for s in samples if s.time_s > 10.0) < 0.05
    assert tilt_max_rad(samples) < DEFAULT.tilt_max_rad


def test_wind_step_without_knowing_the_drag() -> None:
    parameters = replace(DEFAULT, drag_1_s=(0.0, 0.0, 0.0))
    samples = Flight(reference_at=hover, parameters=parameters, wind_at=gust).fly(14.0)
    assert max(s.error_m for s in samples) < 0.5
    assert max(s.error_m for s in samples if s.time_s > 10.0) < 0.05


def test_vehicle_that_leans_against_the_wind_is_taken_over_as_it_is() -> None:
    leaning = frames.from_rpy(0.0, atan2(5.0, 9.81), 0.0)  # 5 m/s from the south: nose up, thrust to the south
    flight = Flight(reference_at=hover, parameters=DEFAULT, wind_at=lambda _: (5.0, 0.0, 0.0), start_wb=leaning)
    assert max(s.error_m for s in flight.fly(6.0)) < 0.1


@pytest.mark.parametrize("factor", [0.75, 1.25])
def test_wrong_hover_thrust_at_engage(factor: float) -> None:
    samples = Flight(reference_at=hover, parameters=replace(DEFAULT, hover_thrust=0.4905 * factor)).fly(15.0)
    assert max(abs(s.truth.position_ned_m[2] + HOVER_HEIGHT_M) for s in samples) < 0.3
    assert samples[-1].error_m < 0.05
    assert samples[-1].record.hover_thrust == pytest.approx(0.4905, rel=0.05)


def test_move_of_ten_metres_does_not_overshoot() -> None:
    samples = Flight(reference_at=move(10.0, 6.0), parameters=DEFAULT).fly(12.0)
    assert max(s.truth.position_ned_m[0] for s in samples) < 10.2
    assert samples[-1].error_m < 0.02


def test_jump_of_the_reference_is_flown_without_overshoot_nor_flip() -> None:
    def jump(t: float) -> Reference:
        return Reference(t, (0.0 if t < 1.0 else 10.0, 0.0, -HOVER_HEIGHT_M), yaw_rad=0.0 if t < 1.0 else 2.5)

    samples = Flight(reference_at=jump, parameters=DEFAULT).fly(12.0)
    assert max(s.truth.position_ned_m[0] for s in samples) < 10.2
    assert max(abs(s.truth.position_ned_m[2] + HOVER_HEIGHT_M) for s in samples) < 0.2
    assert tilt_max_rad(samples) < DEFAULT.tilt_max_rad
    assert frames.yaw_of(samples[-1].truth.attitude_wb) == pytest.approx(2.5, abs=0.02)


def test_far_reference_is_approached_at_a_bounded_speed() -> None:
    def far(t: float) -> Reference:
        return Reference(t, (0.0 if t < 1.0 else 500.0, 0.0, -HOVER_HEIGHT_M if t < 1.0 else -60.0))

    samples = Flight(reference_at=far, parameters=DEFAULT).fly(12.0)
    assert max(frames.norm(s.truth.velocity_ned_m_s) for s in samples) < 1.5 * DEFAULT.approach_max_m_s
    assert tilt_max_rad(samples) < DEFAULT.tilt_max_rad


@pytest.mark.parametrize("more_steps", [5, 10], ids=["20 ms", "40 ms"])
def test_tilt_stays_within_its_limit_with_a_delay_that_nobody_configured(more_steps: int) -> None:
    def jump(t: float) -> Reference:
        return Reference(t, (0.0 if t < 1.0 else 10.0, 0.0, -HOVER_HEIGHT_M))

    samples = Flight(reference_at=jump, parameters=DEFAULT, uplink_steps=1 + more_steps).fly(8.0)
    assert radians(30.0) < tilt_max_rad(samples) < DEFAULT.tilt_max_rad
    assert samples[-1].record.late_s == pytest.approx(0.004 * more_steps, abs=0.015)


def test_forty_milliseconds_more_delay() -> None:
    flight = Flight(reference_at=lemniscate(8.0), parameters=FAST, errors=RecordedErrors(), uplink_steps=11)
    samples = [s for s in flight.fly(lap_s(8.0)) if s.time_s > RUN_IN_S]
    assert rms([s.estimate_error_m for s in samples]) < 0.2


def test_thirty_percent_of_payload() -> None:
    samples = Flight(reference_at=lemniscate(5.0), parameters=FAST, payload_kg=0.3).fly(lap_s(5.0))
    assert rms([s.error_m for s in samples if s.time_s > RUN_IN_S]) < 0.06


def test_heading_spin_does_not_disturb_the_path() -> None:
    def spin(t: float) -> Reference:
        return replace(lemniscate(5.0)(t), yaw_rad=frames.wrap_pi(t), yaw_rate_rad_s=1.0)

    samples = Flight(reference_at=spin, parameters=FAST).fly(lap_s(5.0))
    late = [s for s in samples if s.time_s > RUN_IN_S]
    assert rms([s.error_m for s in late]) < 0.04
    turned = [frames.wrap_pi(frames.yaw_of(s.truth.attitude_wb) - s.reference.yaw_rad) for s in late]
    assert max(abs(v) for v in turned) < radians(5.0)


def test_vertical_circle() -> None:
    w, r = 1.2, 2.0

    def circle(t: float) -> Reference:
        c, s = cos(w * t), sin(w * t)
        return Reference(
            t,
            (r * c, 0.0, -20.0 + r * s),
            (-r * w * s, 0.0, r * w * c),
            (-r * w * w * c, 0.0, -r * w * w * s),
            (r * w**3 * s, 0.0, -r * w**3 * c),
        )

    samples = Flight(reference_at=circle, parameters=FAST).fly(12.0)
    assert rms([s.error_m for s in samples if s.time_s > RUN_IN_S]) < 0.05


def test_law_and_gains_switch_in_flight_without_leaving_the_path() -> None:
    other = replace(FAST, attitude_law=AttitudeLaw.JERK, position_gain_1_s2=(5.0, 5.0, 6.0))
    samples = Flight(reference_at=lemniscate(5.0), parameters=FAST, switched=(8.0, other)).fly(14.0)
    assert max(s.error_m for s in samples if s.time_s > RUN_IN_S) < 0.05


@pytest.mark.parametrize("rate_lag_s", [0.05, 0.08])
def test_gains_from_two_numbers_fly_out_of_the_box(rate_lag_s: float) -> None:
    parameters = from_airframe(0.4905, rate_lag_s)
    samples = Flight(reference_at=hover, parameters=parameters, wind_at=gust, errors=RecordedErrors()).fly(20.0)
    assert rms([s.estimate_error_m for s in samples if s.time_s > 12.0]) < 0.2
