"""The order of samples: overtaken, set back, rebooted."""

from daemon.autopilot.ordering import Order, SampleOrder


def judged(stamped: list[tuple[int, float]]) -> list[Order]:
    order = SampleOrder()
    return [order.judge("ODOMETRY", round(stamp_s * 1e6), arrival_s) for stamp_s, arrival_s in stamped]


def test_one_sample_that_was_overtaken_is_dropped() -> None:
    assert judged([(60.0, 0.0), (60.02, 0.02), (60.01, 0.021), (60.03, 0.03)]) == [
        Order.NEWER, Order.NEWER, Order.OVERTAKEN, Order.NEWER
    ]  # fmt: skip


def test_samples_overtaken_now_and_then_never_set_the_clock_back() -> None:
    found = judged([(60.0 + 0.01 * i - (0.03 if i % 3 == 0 else 0.0), 0.01 * i) for i in range(1, 30)])
    assert found.count(Order.OVERTAKEN) == 9


def test_the_streams_are_judged_apart() -> None:
    order = SampleOrder()
    assert order.judge("ODOMETRY", 60_000_000, 0.0) is Order.NEWER
    assert order.judge("HIGHRES_IMU", 59_000_000, 0.0) is Order.NEWER


def test_a_reboot_shows_an_uptime_that_began_after_the_last_sample() -> None:
    assert judged([(60.0, 0.0), (3.0, 4.0)])[1] is Order.REBOOTED
    assert judged([(60.0, 0.0), (0.004, 0.02)])[1] is Order.REBOOTED
    assert judged([(60.0, 0.0), (58.0, 4.0)])[1] is Order.OVERTAKEN  # it has been running all the time
    assert judged([(1.2, 0.0), (0.9, 1.0)])[1] is Order.OVERTAKEN
