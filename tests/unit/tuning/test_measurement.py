from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from support.tuning import MadeUp, made_up

from daemon.tuning.measurement import Measured, PoorDataError, hover_thrust, measure


@cache
def default() -> Measured:
    return measure(made_up(MadeUp()))


def test_a_made_up_vehicle_is_found_again() -> None:
    found = default()
    for loop, dead_s, lag_s, gain in (
        (found.roll, 0.03, 0.055, 1.0),
        (found.pitch, 0.03, 0.06, 1.0),
        (found.yaw, 0.12, 0.3, 0.9),
    ):
        assert loop.total_s.value == pytest.approx(dead_s + lag_s, abs=0.006)
        assert loop.lag_s.value == pytest.approx(lag_s, rel=0.06)
        assert loop.gain.value == pytest.approx(gain, abs=0.02)
    assert found.thrust.hover_thrust.value == pytest.approx(0.55, abs=0.002)
    assert found.thrust.total_s.value == pytest.approx(0.07, abs=0.01)
    assert found.thrust.slope == pytest.approx(1.0, abs=0.05)
    assert found.age_s == pytest.approx(0.012)


def test_errors_are_of_the_size_of_what_is_wrong() -> None:
    noisy = replace(MadeUp(), rate_noise_rad_s=0.1, velocity_noise_m_s=0.03)
    quiet, found = default(), measure(made_up(noisy))
    assert found.roll.total_s.error > quiet.roll.total_s.error
    assert abs(found.roll.total_s.value - 0.085) < 4.0 * found.roll.total_s.error
    assert abs(found.thrust.hover_thrust.value - 0.55) < 4.0 * found.thrust.hover_thrust.error


def test_force_with_the_square_of_the_command_shows_in_the_slope() -> None:
    assert measure(made_up(replace(MadeUp(), slope=2.0))).thrust.slope == pytest.approx(2.0, abs=0.1)


@pytest.mark.parametrize("trim", [0.01, -0.01])
def test_hover_thrust_is_that_of_rest_when_the_vehicle_climbs_or_sinks(trim: float) -> None:
    assert measure(made_up(MadeUp(trim=trim))).thrust.hover_thrust.value == pytest.approx(0.55, abs=0.0015)


def test_hover_thrust_is_that_of_rest_when_the_vehicle_gathers_speed() -> None:
    """0.01 of thrust beyond hover, at 20 m/s2 for all of it, is a climb that quickens by 0.2 m/s2."""
    fit = replace(default().thrust.fit, full_thrust_m_s2=20.0, drag_1_s=0.0)
    time_s = np.arange(0.0, 2.5, 0.002)
    window = replace(default().thrust.windows[0], time_s=time_s, command=0.0 * time_s + 0.51, response=-0.2 * time_s)
    assert hover_thrust(window, fit) == pytest.approx(0.5, abs=0.001)


def test_a_stall_of_the_machine_in_one_pulse_does_not_move_the_figures() -> None:
    recording = made_up(MadeUp())
    begun_s = recording.begun_s + recording.programme[2].start_s
    late = [replace(s, time_s=s.time_s - 0.15) if begun_s < s.time_s < begun_s + 0.9 else s for s in recording.sent]
    found = measure(replace(recording, sent=sorted(late, key=lambda s: s.time_s)))
    assert found.roll.total_s.value == pytest.approx(0.085, abs=0.006)


@pytest.mark.parametrize(
    ("vehicle", "words"),
    [
        (MadeUp(rate_noise_rad_s=1.0), "roll: .* not explained"),
        (MadeUp(gain=(1.0, 0.3, 0.9)), "pitch: the rate comes to 3.%"),
        (MadeUp(gain=(1.0, 1.0, -0.9)), "yaw: "),
        (MadeUp(slope=0.2), "thrust: a change of thrust acts 0.2 times"),
        (MadeUp(slope=-1.0), "thrust: thrust does not raise"),
        (MadeUp(velocity_noise_m_s=1.0), "thrust: "),
    ],
)
def test_poor_data_is_refused_with_the_axis_and_the_reason(vehicle: MadeUp, words: str) -> None:
    with pytest.raises(PoorDataError, match=words):
        measure(made_up(vehicle))


def test_every_fault_is_told() -> None:
    with pytest.raises(PoorDataError) as refused:
        measure(made_up(MadeUp(gain=(0.3, 0.3, 0.9), slope=0.2)))
    assert len(refused.value.faults) == 3


def test_too_little_telemetry_is_refused() -> None:
    recording = made_up(MadeUp())
    with pytest.raises(PoorDataError, match="ODOMETRY came at 10 Hz"):
        measure(replace(recording, samples=recording.samples[::10]))
    with pytest.raises(PoorDataError, match="overloaded"):
        measure(replace(recording, sent=recording.sent[::20]))
    with pytest.raises(PoorDataError, match="ODOMETRY"):
        measure(replace(recording, samples=[], sent=[]))


def test_telemetry_that_is_no_number_is_refused() -> None:
    recording = made_up(MadeUp())
    bad = [
        replace(s, state=replace(s.state, rates_frd_rad_s=(np.nan, 0.0, 0.0))) if i % 50 == 0 else s
        for i, s in enumerate(recording.samples)
    ]
    with pytest.raises(PoorDataError, match="roll: samples must be finite"):
        measure(replace(recording, samples=bad))
