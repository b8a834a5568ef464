"""The loop benchmark's arithmetic: delays by the number that was used, periods, ratios; the autopilot's end."""

import pytest
from pymavlink.dialects.v20 import development as dialect

from daemon.bench import loop, loop_report
from daemon.bench.quantiles import quantile
from daemon.sim.mavlink_codec import MavlinkCodec
from daemon.sim.metronome import Template, checksum


def test_quantile_is_the_nearest_rank() -> None:
    assert [quantile([3.0, 1.0, 2.0], share) for share in (0.0, 0.5, 1.0)] == [1.0, 2.0, 3.0]
    assert quantile([], 0.5) != quantile([], 0.5)


def said(**more: object) -> loop.Figures:
    return {"from_s": 0.0, "to_s": 10.0, "cpu_s": 1.0, "rss_mb": 50.0, **more}


def test_a_client_tells_in_the_thrust_which_odometry_it_used() -> None:
    log = {
        "odometry": [(1, 1.000), (2, 1.010), (3, 1.020)],
        "setpoints": [(1.003, 0.3001), (1.015, 0.3001), (1.0205, 0.3002)],
    }
    figures = loop.figures_of(said(), log, 0.01)
    assert figures["delay_p50_ms"] == pytest.approx(10.5)
    assert figures["setpoints"] == 3
    # The second was overtaken by 5 ms; the third by half a millisecond, which does not count.
    assert figures["overtaken_pct"] == pytest.approx(100.0 / 3.0)
    assert figures["cpu_pct"] == pytest.approx(10.0)


def test_the_daemon_tells_at_which_tick_it_used_which() -> None:
    log = {"odometry": [(1, 1.000), (2, 1.010)], "setpoints": [(1.002, 0.5), (1.012, 0.5), (11.0, 0.5)]}
    figures = loop.figures_of(said(used=[(1.001, 1), (1.011, 2)]), log, 0.01)
    assert (figures["delay_p50_ms"], figures["delay_p99_ms"]) == pytest.approx((2.0, 2.0))
    assert figures["deviation_p99_ms"] == pytest.approx(0.0)
    assert figures["setpoints"] == 2
    assert "used" not in figures


def test_a_number_that_came_round_again_is_the_newest_of_its_name() -> None:
    log = {"odometry": [(1, 1.0), (2, 2.0), (1, 3.0)], "setpoints": [(3.5, 0.3001)]}
    assert loop.figures_of(said(), log, 0.01)["delay_p50_ms"] == pytest.approx(500.0)


def test_a_ratio_is_to_the_client_of_the_same_run() -> None:
    flights = {"flightd": {"cpu_pct": 6.0}, "asyncio API": {"cpu_pct": 8.0}}
    assert loop_report.ratios(flights) == {"CPU / asyncio API": 0.75}
    text = loop_report.compared(flights, {"flights": {"flightd": {"cpu_pct": 4.0}, "asyncio API": {"cpu_pct": 8.0}}})
    assert text.splitlines()[1].split()[-2:] == ["0.75", "0.50"]


def test_checksum_is_mavlinks() -> None:
    assert checksum(b"123456789") == 0x6F91  # CRC-16/MCRF4XX's check value


def test_a_template_is_a_packet_that_pymavlink_takes() -> None:
    packet = Template(MavlinkCodec(1).encode("ODOMETRY", {"q": [1.0, 0.0, 0.0, 0.0], "quality": 1}), 91)
    decoder = dialect.MAVLink(None)
    for stamp_us, number in ((1, 0), (2**40, 4095)):
        (message,) = decoder.parse_buffer(packet.stamped(stamp_us, number))
        assert message.get_type() == "ODOMETRY"
        assert message.time_usec == stamp_us
        assert round(message.x * 1e6) == number
