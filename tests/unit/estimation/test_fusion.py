from dataclasses import replace
from math import cos, inf, pi, sin

import numpy as np
import pytest

from daemon.estimation import fusion
from daemon.estimation.fusion import FusionParameters, flight_filter
from daemon.estimation.ukf import Unscented
from daemon.frames import angle_between, from_rpy, from_yaw, multiply, rotate_about_down, yaw_of
from daemon.messages import EstimatedState, ExternalPose, Reset

PARAMETERS = FusionParameters()
RADIUS, RATE = 4.0, 0.6


def truth(t):
    """A banked circle, nose along the flight: 2.4 m/s, 1.44 m/s2."""
    yaw = RATE * t + pi / 2
    return EstimatedState(
        t,
        (RADIUS * cos(RATE * t), RADIUS * sin(RATE * t), -5.0),
        (-RADIUS * RATE * sin(RATE * t), RADIUS * RATE * cos(RATE * t), 0.0),
        multiply(from_yaw(yaw), from_rpy(0.15, 0.0, 0.0)),
        (0.0, RATE * sin(0.15), RATE * cos(0.15)),
        0.04,
    )


def acceleration(t):
    return (-RADIUS * RATE**2 * cos(RATE * t), -RADIUS * RATE**2 * sin(RATE * t), 0.0)


def noisy(t, rng):
    s = truth(t)
    return EstimatedState(
        t,
        tuple(np.array(s.position_ned_m) + rng.normal(0.0, 0.02, 3)),
        tuple(np.array(s.velocity_ned_m_s) + rng.normal(0.0, 0.1, 3)),
        multiply(s.attitude_wb, from_rpy(*rng.normal(0.0, 0.01, 3))),
        tuple(np.array(s.rates_frd_rad_s) + rng.normal(0.0, 0.08, 3)),
        0.04,
    )


def circle_times(seconds):
    """The autopilot's stamps: 8 and 16 ms mixed."""
    t, k, times = 0.0, 0, []
    while t < seconds:
        times.append(t)
        t += 0.016 if k % 4 == 3 else 0.008
        k += 1
    return times


def errors(parameters, seed=1, seconds=6.0):
    rng = np.random.default_rng(seed)
    state = fusion.initial(parameters)
    found = []
    for t in circle_times(seconds):
        sample = noisy(t, rng)
        state, fused = fusion.step(state, sample, None, acceleration(t), t, parameters=parameters)
        assert fused.estimate is not None
        assert all(c.refused is None for c in fused.corrections)
        true, seen = truth(t), fused.estimate
        if t > 2.0:
            found.append(
                [
                    np.subtract(seen.position_ned_m, true.position_ned_m),
                    np.subtract(seen.velocity_ned_m_s, true.velocity_ned_m_s),
                    np.subtract(seen.rates_frd_rad_s, true.rates_frd_rad_s),
                    np.full(3, angle_between(seen.attitude_wb, true.attitude_wb)),
                ]
            )
    return np.array(found)


@pytest.mark.parametrize("predictor", [flight_filter().predictor, Unscented()])
def test_on_a_circle_it_is_nearer_to_the_truth_than_the_odometry_and_does_not_lag(predictor):
    found = errors(FusionParameters(filter=flight_filter(predictor)))
    position, velocity, rates, angle = np.sqrt((found**2).mean(axis=(0, 2)))
    assert position < 0.02 * 0.6
    assert velocity < 0.1 * 0.6
    assert rates < 0.08 * 0.9
    assert angle < 0.01 * 3**0.5 * 0.8
    assert np.abs(found[:, 1].mean(axis=0)).max() < 0.02
    assert np.abs(found[:, 0].mean(axis=0)).max() < 0.01


def test_nothing_is_known_before_the_first_odometry_and_the_first_is_taken_as_it_is():
    state, fused = fusion.step(fusion.initial(PARAMETERS), None, pose(0.0), (0.0, 0.0, 0.0), 0.0, parameters=PARAMETERS)
    assert fused.estimate is None
    assert [c.refused for c in fused.corrections] == ["not_started"]
    _, fused = fusion.step(state, truth(0.01), None, (0.0, 0.0, 0.0), 0.02, parameters=PARAMETERS)
    assert fused.estimate is not None
    assert fused.estimate.time_s == 0.01
    assert fused.estimate.position_ned_m == pytest.approx(truth(0.01).position_ned_m)
    assert fused.estimate.velocity_ned_m_s == pytest.approx(truth(0.01).velocity_ned_m_s)
    assert not fused.restarted


def pose(stamp_s, offset=(0.0, 0.0, 0.0), variance=1e-4):
    p = np.add(truth(stamp_s).position_ned_m, offset)
    return ExternalPose(stamp_s, tuple(p), truth(stamp_s).attitude_wb, (variance,) * 3)


def fly(state, times, parameters=PARAMETERS, poses=None, of=truth):
    fused = None
    for t in times:
        state, fused = fusion.step(
            state, of(t), (poses or {}).get(t), acceleration(t), t + 0.013, parameters=parameters
        )
    return state, fused


def test_a_pose_from_outside_counts_and_a_late_one_as_if_it_had_been_in_time():
    times = [0.01 * k for k in range(1, 91)]
    offset = (0.05, -0.03, 0.02)
    stamp = 0.01 * 80 + 0.005
    _, alone = fly(fusion.initial(PARAMETERS), times)
    _, prompt = fly(fusion.initial(PARAMETERS), times, poses={times[80]: pose(stamp, offset)})
    _, late = fly(fusion.initial(PARAMETERS), times, poses={times[86]: pose(stamp, offset)})
    np.testing.assert_allclose(late.estimate.position_ned_m, prompt.estimate.position_ned_m, atol=1e-6)
    pulled = np.subtract(late.estimate.position_ned_m, alone.estimate.position_ned_m)
    assert pulled @ np.array(offset) > 0.2 * np.dot(offset, offset)


@pytest.mark.parametrize(
    ("stamp_s", "reason"), [(0.3, "too_old"), (1.2, "stamp_ahead"), (float("nan"), "stamp"), (inf, "stamp_ahead")]
)
def test_a_pose_at_an_impossible_time_is_refused_by_name(stamp_s, reason):
    state, before = fly(fusion.initial(PARAMETERS), [0.01 * k for k in range(1, 101)])
    bad = replace(pose(0.5), stamp_s=stamp_s)
    _, fused = fusion.step(state, None, bad, acceleration(1.0), 1.013, parameters=PARAMETERS)
    assert [c.refused for c in fused.corrections] == [reason]
    assert fused.estimate.position_ned_m == before.estimate.position_ned_m


def test_a_pose_far_off_is_gated_out():
    state, _ = fly(fusion.initial(PARAMETERS), [0.01 * k for k in range(1, 101)])
    _, fused = fusion.step(state, None, pose(1.0, (5.0, 0.0, 0.0)), acceleration(1.0), 1.01, parameters=PARAMETERS)
    assert [c.refused for c in fused.corrections] == ["mahalanobis"]
    assert fused.estimate.position_variance_m2 >= truth(1.0).position_variance_m2


def test_the_attitude_of_a_pose_counts():
    state, before = fly(fusion.initial(PARAMETERS), [0.01 * k for k in range(1, 101)])
    turned = replace(pose(1.0), attitude_wb=multiply(from_yaw(0.03), truth(1.0).attitude_wb))
    _, fused = fusion.step(state, None, turned, acceleration(1.0), 1.01, parameters=PARAMETERS)
    assert yaw_of(fused.estimate.attitude_wb) - yaw_of(before.estimate.attitude_wb) > 0.003


def test_poses_alone_may_give_the_position():
    parameters = FusionParameters(odometry_axes=(False,) * 3 + (True,) * 9)
    times = [0.01 * k for k in range(1, 101)]
    _, fused = fly(fusion.initial(parameters), times, parameters, poses={t: pose(t) for t in times[10::3]})
    np.testing.assert_allclose(fused.estimate.position_ned_m, truth(1.0).position_ned_m, atol=0.03)


def test_poses_hold_the_position_when_the_odometry_has_lost_its_own():
    """The odometry drifts off at 2 m/s and says so; poses at 30 Hz keep the estimate and its variance."""

    def lost(t):
        s = truth(t)
        drift = max(0.0, t - 1.0)
        return replace(
            s,
            position_ned_m=tuple(np.add(s.position_ned_m, (2.0 * drift, 0, 0))),
            position_variance_m2=0.04 + 9 * drift,
        )

    times = [0.01 * k for k in range(1, 401)]
    poses = {t: pose(t - 0.02) for t in times[3::3]}
    _, fused = fly(fusion.initial(PARAMETERS), times, poses=poses, of=lost)
    assert np.linalg.norm(np.subtract(fused.estimate.position_ned_m, truth(4.0).position_ned_m)) < 0.1
    assert fused.estimate.position_variance_m2 < 0.01
    _, alone = fly(fusion.initial(PARAMETERS), times, of=lost)
    assert alone.estimate.position_variance_m2 > 20.0


@pytest.mark.parametrize("unknown", [float("nan"), inf])
def test_an_unknown_variance_of_the_odometry_stays_unknown(unknown):
    _, fused = fly(
        fusion.initial(PARAMETERS), [0.01, 0.02], of=lambda t: replace(truth(t), position_variance_m2=unknown)
    )
    assert fused.estimate.position_variance_m2 >= 1e6


RESET = Reset(1.0, frozenset({"position_ne", "heading"}), (3.0, -2.0, 1.0), (0.5, 0.2, -0.1), 0.5)


def after_reset(t, reset=RESET):
    """What the autopilot says of the same flight after a reset: shifted in position, velocity and heading."""
    s = truth(t)
    return replace(
        s,
        position_ned_m=tuple(np.add(s.position_ned_m, reset.position_ned_m)),
        velocity_ned_m_s=tuple(np.add(s.velocity_ned_m_s, reset.velocity_ned_m_s)),
        attitude_wb=multiply(from_yaw(reset.yaw_rad), s.attitude_wb),
    )


def test_a_reset_renames_the_estimate_at_once():
    state, before = fly(fusion.initial(PARAMETERS), [0.01 * k for k in range(1, 101)])
    state = fusion.shifted(state, RESET)
    _, fused = fusion.step(state, None, None, acceleration(1.0), 1.013, parameters=PARAMETERS)
    old, new = before.estimate, fused.estimate
    np.testing.assert_allclose(np.subtract(new.position_ned_m, old.position_ned_m), RESET.position_ned_m, atol=1e-12)
    np.testing.assert_allclose(
        np.subtract(new.velocity_ned_m_s, old.velocity_ned_m_s), RESET.velocity_ned_m_s, atol=1e-12
    )
    expected = multiply(from_yaw(RESET.yaw_rad), old.attitude_wb)
    assert angle_between(new.attitude_wb, expected) < 1e-7
    assert new.rates_frd_rad_s == old.rates_frd_rad_s
    np.testing.assert_allclose(state.lagged.state.predicted_x[:3], new.position_ned_m, atol=0.01)


def test_a_reset_renames_the_measurements_that_a_replay_will_use():
    rng = np.random.default_rng(4)
    state, _ = fly(fusion.initial(PARAMETERS), [0.01 * k for k in range(1, 11)], of=lambda t: noisy(t, rng))
    place = replace(RESET, velocity_ned_m_s=(0.0, 0.0, 0.0))
    renamed = fusion.shifted(state, place)
    for old, new in zip(state.lagged.history, renamed.lagged.history, strict=True):
        moved = np.subtract(new.measurement.values, old.measurement.values)
        np.testing.assert_allclose(moved[:3], place.position_ned_m, atol=1e-12)
        assert sin(moved[5] - place.yaw_rad) == pytest.approx(0.0, abs=1e-12)
        np.testing.assert_array_equal(moved[[3, 4, 9, 10, 11]], 0.0)


def test_a_reset_before_the_first_sample_is_nothing():
    state = fusion.shifted(fusion.initial(PARAMETERS), RESET)
    assert not state.lagged.state.x.any()


def test_samples_after_a_reset_find_the_filter_where_they_are():
    state, _ = fly(fusion.initial(PARAMETERS), [0.01 * k for k in range(1, 101)])
    plain, _ = fusion.step(state, truth(1.01), None, acceleration(1.01), 1.02, parameters=PARAMETERS)
    _, unshifted = fusion.step(state, after_reset(1.01), None, acceleration(1.01), 1.02, parameters=PARAMETERS)
    shifted = fusion.shifted(state, RESET)
    _, fused = fusion.step(shifted, after_reset(1.01), None, acceleration(1.01), 1.02, parameters=PARAMETERS)
    assert unshifted.corrections[0].refused == "mahalanobis"
    assert fused.corrections[0].refused is None
    assert np.abs(fused.corrections[0].innovation).max() < 0.02
    assert plain.lagged.state.initialized


@pytest.mark.parametrize(
    ("velocity", "reasons"), [((0.0, 0.0, 0.0), {None}), ((0.5, 0.2, -0.1), {"too_old"})], ids=["place", "velocity"]
)
def test_a_pose_from_before_a_reset_still_fits_unless_the_velocity_was_wrong(velocity, reasons):
    reset = replace(RESET, time_s=1.005, velocity_ned_m_s=velocity)
    state, _ = fly(fusion.initial(PARAMETERS), [0.01 * k for k in range(1, 101)])
    state = fusion.shifted(state, reset)
    state, _ = fusion.step(state, after_reset(1.01, reset), None, acceleration(1.0), 1.02, parameters=PARAMETERS)
    _, fused = fusion.step(state, None, pose(0.905), acceleration(1.0), 1.03, parameters=PARAMETERS)
    assert fused.corrections[0].source == "pose"
    assert {c.refused for c in fused.corrections} == reasons
    assert max((abs(v) for c in fused.corrections for v in c.innovation), default=0.0) < 0.01


def test_a_reset_that_is_not_finite_shifts_nothing():
    state, before = fly(fusion.initial(PARAMETERS), [0.01, 0.02])
    state = fusion.shifted(state, replace(RESET, yaw_rad=float("nan")))
    _, fused = fusion.step(state, None, None, (0.0, 0.0, 0.0), 0.04, parameters=PARAMETERS)
    assert fused.estimate.position_ned_m == before.estimate.position_ned_m


def test_a_lasting_refusal_does_not_lock_the_vehicle_out():
    state, _ = fly(fusion.initial(PARAMETERS), [0.01 * k for k in range(1, 101)])
    restarted_s = None
    for k in range(101, 201):
        t = 0.01 * k
        state, fused = fusion.step(state, after_reset(t), None, acceleration(t), t + 0.01, parameters=PARAMETERS)
        if fused.restarted:
            restarted_s = t
            break
        assert fused.corrections[0].refused == "mahalanobis"
    assert restarted_s == pytest.approx(1.0 + PARAMETERS.restart_s, abs=0.05)
    assert fused.estimate.position_ned_m == pytest.approx(after_reset(restarted_s).position_ned_m)


def test_after_a_long_gap_it_starts_anew():
    parameters = replace(PARAMETERS, odometry_gate_sigma=inf, restart_s=inf)
    state, _ = fly(fusion.initial(parameters), [0.01 * k for k in range(1, 101)], parameters)
    _, fused = fusion.step(state, truth(3.0), None, acceleration(3.0), 3.01, parameters=parameters)
    assert fused.restarted
    assert fused.estimate.position_ned_m == pytest.approx(truth(3.0).position_ned_m)


def test_a_filter_that_cannot_predict_starts_anew_at_once():
    def broken(x, P, dt_s, acceleration, noise):
        return x * np.nan, P.copy()

    state, _ = fly(fusion.initial(PARAMETERS), [0.01 * k for k in range(1, 101)])
    parameters = replace(PARAMETERS, filter=flight_filter(broken))
    far = replace(truth(1.01), position_ned_m=(7.0, 8.0, 9.0))
    state, fused = fusion.step(state, far, None, acceleration(1.01), 1.02, parameters=parameters)
    assert fused.restarted
    assert fused.estimate.time_s == 1.01
    assert fused.estimate.position_ned_m == (7.0, 8.0, 9.0)
    _, fused = fusion.step(state, None, pose(1.015), acceleration(1.02), 1.03, parameters=parameters)
    assert [c.refused for c in fused.corrections] == ["unpredicted"]
    assert fused.estimate.time_s == 1.01


def test_the_same_sample_counts_once():
    state, _ = fly(fusion.initial(PARAMETERS), [0.01, 0.02], poses={0.02: pose(0.015)})
    assert state.pose is not None
    _, fused = fusion.step(state, state.sample, state.pose, (0.0, 0.0, 0.0), 0.03, parameters=PARAMETERS)
    assert fused.corrections == ()


def test_odometry_can_be_taken_in_part():
    parameters = FusionParameters(odometry_axes=(False,) * 3 + (True,) * 9)
    far = lambda t: replace(truth(t), position_ned_m=(50.0, 50.0, 50.0))  # noqa: E731
    _, fused = fly(fusion.initial(parameters), [0.01, 0.02], parameters, of=far)
    assert np.abs(fused.estimate.position_ned_m).max() < 1.0
    assert fused.corrections[0].indices == tuple(range(3, 12))


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("bad", [float("nan"), inf, -inf, 1e300])
def test_bad_numbers_do_not_get_out(bad):
    state, _ = fly(fusion.initial(PARAMETERS), [0.01 * k for k in range(1, 51)])
    t = 0.51
    wrong = EstimatedState(t, (bad, 0, 0), (0, bad, 0), (bad, 0, 0, 0), (bad,) * 3, bad)
    for sample, outside, command in (
        (wrong, None, (bad,) * 3),
        (None, ExternalPose(t, (bad,) * 3, (bad,) * 4, (bad,) * 3, (bad,) * 3), (0.0, bad, 0.0)),
        (replace(truth(0.53), position_variance_m2=bad), None, (bad, 0.0, 0.0)),
    ):
        state, fused = fusion.step(state, sample, outside, command, t + 0.02, parameters=PARAMETERS)
        e = fused.estimate
        assert np.isfinite((*e.position_ned_m, *e.velocity_ned_m_s, *e.attitude_wb, *e.rates_frd_rad_s)).all()
        assert np.isfinite(e.position_variance_m2)


def test_a_turn_of_the_frame_does_not_turn_the_velocity():
    """Heading resets rename the heading only: the velocity in NED keeps its numbers, so the body sees another one."""
    state, before = fly(fusion.initial(PARAMETERS), [0.01 * k for k in range(1, 101)])
    only_yaw = Reset(1.0, frozenset({"heading"}), yaw_rad=pi / 2)
    _, fused = fusion.step(fusion.shifted(state, only_yaw), None, None, (0.0, 0.0, 0.0), 1.02, parameters=PARAMETERS)
    np.testing.assert_allclose(fused.estimate.velocity_ned_m_s, before.estimate.velocity_ned_m_s, atol=1e-12)
    turned = rotate_about_down(before.estimate.velocity_ned_m_s, pi / 2)
    assert np.linalg.norm(np.subtract(fused.estimate.velocity_ned_m_s, turned)) > 1.0
