"""EKF and UKF on ODOMETRY of the real PX4: no sample refused, nothing lurches when the autopilot's frame jumps."""

import numpy as np
import pytest

from daemon.estimation import estimator, fusion
from daemon.estimation.estimator import EstimatorParameters
from daemon.estimation.fusion import FusionParameters, flight_filter
from daemon.estimation.ukf import Unscented
from daemon.frames import angle_between
from daemon.messages import ZERO3

ESTIMATOR = EstimatorParameters()


def replay(messages, predictor=None, shift=True):
    parameters = FusionParameters(filter=flight_filter(predictor or flight_filter().predictor))
    accepted, filtered = estimator.initial(ESTIMATOR), fusion.initial(parameters)
    for message in messages:
        now_s = message.arrival_s
        accepted, estimate = estimator.step(accepted, message, None, ZERO3, now_s, parameters=ESTIMATOR)
        if estimate.reset is not None and shift:
            filtered = fusion.shifted(filtered, estimate.reset)
        filtered, fused = fusion.step(filtered, estimate.newest, None, ZERO3, now_s, parameters=parameters)
        yield estimate, fused


def apart(estimate, fused):
    return (
        float(np.linalg.norm(np.subtract(fused.estimate.position_ned_m, estimate.newest.position_ned_m))),
        float(np.linalg.norm(np.subtract(fused.estimate.velocity_ned_m_s, estimate.newest.velocity_ned_m_s))),
        angle_between(fused.estimate.attitude_wb, estimate.newest.attitude_wb),
    )


@pytest.mark.parametrize("name", ["ekf_resets", "gps_loss", "lemniscate", "rate_steps", "wind"])
def test_no_sample_of_a_recorded_flight_is_refused_and_the_filter_stays_with_it(recorded, name):
    worst, before_s = np.zeros(3), -np.inf
    for estimate, fused in replay(recorded(name)):
        assert fused.restarted == (0.5 < estimate.newest.time_s - before_s < np.inf)  # at the cuts of the recording
        before_s = estimate.newest.time_s
        assert [c.refused for c in fused.corrections] in ([], [None])
        worst = np.maximum(worst, apart(estimate, fused))
    assert worst[0] < 0.6  # the slide after GPS came back
    assert worst[1] < 0.3
    assert worst[2] < 0.05


def test_at_the_recorded_resets_the_filter_is_where_the_sample_is(recorded):
    seen = [apart(e, f) for e, f in replay(recorded("ekf_resets")) if e.reset is not None]
    assert len(seen) >= 12
    assert np.median(seen, axis=0)[0] < 0.05
    assert np.max(seen, axis=0)[0] < 0.2


def test_without_the_shift_the_same_resets_are_refused(recorded):
    refused = [f for e, f in replay(recorded("ekf_resets"), shift=False) if f.corrections and f.corrections[0].refused]
    assert len(refused) > 12


def test_the_ukf_flies_the_recording_as_the_ekf_does(recorded):
    flown = zip(replay(recorded("lemniscate")), replay(recorded("lemniscate"), Unscented()), strict=True)
    for (_, ekf), (_, ukf) in flown:
        assert ukf.estimate.position_ned_m == pytest.approx(ekf.estimate.position_ned_m, abs=0.01)
        assert ukf.estimate.velocity_ned_m_s == pytest.approx(ekf.estimate.velocity_ned_m_s, abs=0.02)
