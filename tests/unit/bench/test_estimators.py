"""The benchmark of the estimators: every tick is timed, with what the estimator saw in flight."""

from daemon.bench import estimators


def test_every_estimator_is_timed_on_the_same_flight() -> None:
    ticks = estimators.recorded()
    assert len(ticks) > 1900
    seen = {id(tick.inputs.odometry) for tick in ticks}
    assert len(seen) > 0.8 * len(ticks)
    assert any(tick.inputs.clock is not None for tick in ticks)
    late_s = [tick.now_s - tick.pose.stamp_s for tick in ticks if tick.pose is not None]
    assert 0.05 < min(late_s) <= max(late_s) < 0.15
    costs = estimators.measured(ticks[:200], rounds=1)
    assert [cost.name for cost in costs] == ["autopilot", "ekf", "ekf, late poses", "ukf"]
    assert all(cost.ticks == 200 and 0.0 < cost.p50_us <= cost.p99_us for cost in costs)
    assert estimators.table(costs).count("\n") == 4
