"""The estimator on ODOMETRY of the real PX4: resets are named and measured, calm flight stays calm."""

from math import degrees

import pytest

from daemon.estimation import estimator
from daemon.estimation.estimator import EstimatorParameters
from daemon.messages import ZERO3

PARAMETERS = EstimatorParameters()


def replay(messages):
    state = estimator.initial(PARAMETERS)
    for message in messages:
        state, estimate = estimator.step(state, message, None, ZERO3, message.arrival_s, parameters=PARAMETERS)
        yield message.arrival_s - 1000.0, estimate


# What was done to the EKF at that second of the flight, and what the message then jumped by.
RESETS = [
    (2.01, {"position_ne"}, (-3.06, 0.0, 0.0), ZERO3, 0.0),
    (7.02, {"position_ne"}, (3.0, 0.0, 0.0), ZERO3, 0.0),
    (12.02, {"position_ne"}, (-11.12, 0.0, 0.0), ZERO3, 0.0),
    (17.04, {"position_ne"}, (11.12, 0.0, 0.0), ZERO3, 0.0),
    (22.04, {"position_d"}, (0.0, 0.0, 2.0), ZERO3, 0.0),
    (27.04, {"position_d"}, (0.0, 0.0, -2.0), ZERO3, 0.0),
    (32.04, {"heading"}, ZERO3, ZERO3, 30.0),
    (39.06, {"position_ne"}, (2.95, 0.0, 0.0), ZERO3, 0.0),
    (54.07, {"position_ne"}, (-3.006, 0.0, 0.0), ZERO3, 0.0),
    (59.07, {"position_d"}, (0.0, 0.0, 2.0), ZERO3, 0.0),
    (64.06, {"position_ne"}, (11.14, 0.0, 0.0), ZERO3, 0.0),
    (65.13, {"position_ne", "velocity_ne", "velocity_d", "heading"}, (-11.15, 0.2, 0.0), (0.0, 0.36, 0.3), -31.0),
]


def test_each_recorded_reset_is_found_with_its_kinds_and_deltas(recorded):
    announced = [
        (t, event)
        for t, estimate in replay(recorded("ekf_resets"))
        for event in estimate.events
        if event.name == "reset"
    ]
    assert len(announced) == len(RESETS)
    for (t, event), (at_s, kinds, position, velocity, yaw_deg) in zip(announced, RESETS, strict=True):
        reset = event.reset
        assert t == pytest.approx(at_s, abs=0.02)
        assert reset.kinds == kinds
        assert reset.position_ned_m == pytest.approx(position, abs=0.2)
        assert reset.velocity_ned_m_s == pytest.approx(velocity, abs=0.2)
        assert degrees(reset.yaw_rad) == pytest.approx(yaw_deg, abs=3.0)
        assert not reset.truth_returned


def test_shift_is_the_sum_of_the_recorded_resets(recorded):
    *_, (_, last) = replay(recorded("ekf_resets"))
    resets = [e.reset for _, estimate in replay(recorded("ekf_resets")) for e in estimate.events if e.reset]
    assert last.shift.count == len(resets)
    for axis in range(3):
        assert last.shift.position_ned_m[axis] == pytest.approx(sum(r.position_ned_m[axis] for r in resets))


def test_lost_gps_is_seen_in_the_variance_long_before_the_position_is_worthless(recorded):
    excess = [t for t, estimate in replay(recorded("gps_loss")) if estimate.position_variance_m2 > 0.3]
    warned = [t for t, estimate in replay(recorded("gps_loss")) if estimate.quality.variance_grows]
    # GPS goes at 7.0 s; at 12 s the vehicle is 6 m off
    assert 9.0 < excess[0] < 10.5
    assert 7.0 < warned[0] < excess[0]


def test_returning_gps_is_the_return_of_the_truth(recorded):
    (t, event), *_ = [(t, e) for t, est in replay(recorded("gps_loss")) for e in est.events if e.name == "reset"]
    assert t == pytest.approx(23.23, abs=0.02)
    assert event.counter_steps == 4
    assert event.reset.truth_returned
    assert {"position_ne", "velocity_ne"} <= event.reset.kinds
    assert event.reset.position_ned_m == pytest.approx((9.4, -75.3, 0.4), abs=0.2)
    assert event.reset.velocity_ned_m_s == pytest.approx((1.6, -10.6, 0.2), abs=0.2)


@pytest.mark.parametrize("flight", ["lemniscate", "rate_steps", "wind"])
def test_calm_flight_shows_no_reset_and_refuses_nothing(recorded, flight):
    estimates = [estimate for _, estimate in replay(recorded(flight))]
    assert not [e for estimate in estimates for e in estimate.events if e.name != "clock_stepped"]
    assert not [estimate.refused for estimate in estimates if estimate.refused]
    assert estimates[-1].shift.count == 0
    assert max(estimate.quality.innovation for estimate in estimates) < 0.5


@pytest.mark.parametrize("flight", ["lemniscate", "rate_steps", "wind"])
def test_age_on_arrival_is_that_of_the_link_and_recovers_after_a_stall_of_the_simulation(recorded, flight):
    ages = sorted(estimate.age_s for t, estimate in replay(recorded(flight)))
    assert ages[len(ages) // 2] == pytest.approx(0.013, abs=0.002)
    assert ages[-10] < 0.035
