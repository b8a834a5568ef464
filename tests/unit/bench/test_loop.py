"""The loop benchmark's arithmetic: delays by the number that was used, periods, ratios; the autopilot's end."""

import os

import pytest
from pymavlink.dialects.v20 import development as dialect

from daemon.bench import loop, loop_report
from daemon.bench.loop_figures import Figures, delays_of, figures_of, over_rounds
from daemon.bench.quantiles import quantile
from daemon.sim.mavlink_codec import MavlinkCodec
from daemon.sim.metronome import Template, checksum


def test_quantile_is_the_nearest_rank() -> None:
    assert [quantile([3.0, 1.0, 2.0], share) for share in (0.0, 0.5, 1.0)] == [1.0, 2.0, 3.0]
    assert quantile([], 0.5) != quantile([], 0.5)


def said(**more: object) -> Figures:
    return {"from_s": 0.0, "to_s": 10.0, "cpu_s": 1.0, "rss_mb": 50.0, **more}


def test_a_client_tells_in_the_thrust_which_odometry_it_used() -> None:
    log = {
        "odometry": [(1, 1.000), (2, 1.010), (3, 1.020)],
        "setpoints": [(1.003, 0.3001), (1.015, 0.3001), (1.0205, 0.3002)],
    }
    figures = figures_of(said(), log, 0.01)
    assert figures["delay_p50_ms"] == pytest.approx(10.5)
    assert figures["setpoints"] == 3
    # The second was overtaken by 5 ms; the third by half a millisecond, which does not count.
    assert figures["overtaken"] == 1
    assert figures["cpu_pct"] == pytest.approx(10.0)


def test_the_daemon_tells_at_which_tick_it_used_which() -> None:
    log = {"odometry": [(1, 1.000), (2, 1.010)], "setpoints": [(1.002, 0.5), (1.012, 0.5), (11.0, 0.5)]}
    figures = figures_of(said(used=[(1.001, 1, 1.0005), (1.011, 2, 1.0105)]), log, 0.01)
    assert (figures["delay_p50_ms"], figures["delay_p99_ms"]) == pytest.approx((2.0, 2.0))
    assert figures["deviation_p99_ms"] == pytest.approx(0.0)
    assert figures["setpoints"] == 2
    assert figures["parts"] == pytest.approx(
        {
            "wire to callback p50_ms": 0.5,
            "wire to callback p99_ms": 0.5,
            "callback to tick p50_ms": 0.5,
            "callback to tick p99_ms": 0.5,
            "tick to wire p50_ms": 1.0,
            "tick to wire p99_ms": 1.0,
        }
    )
    assert "used" not in figures


def test_a_number_that_came_round_again_is_the_newest_of_its_name() -> None:
    log = {"odometry": [(1, 1.0), (2, 2.0), (1, 3.0)], "setpoints": [(3.5, 0.3001)]}
    assert figures_of(said(), log, 0.01)["delay_p50_ms"] == pytest.approx(500.0)


def test_a_sample_that_is_used_again_has_one_first_use() -> None:
    odometry = [(1, 1.000), (2, 1.020), (3, 1.040)]
    setpoints = [(1.002, 0.5), (1.012, 0.5), (1.023, 0.5), (1.033, 0.5)]
    delays = delays_of(setpoints, [(1.001, 1, 1.0), (1.011, 1, 1.0), (1.021, 2, 1.0205), (1.031, 2, 1.0205)], odometry)
    assert delays.every == pytest.approx([0.002, 0.012, 0.003, 0.013])
    assert delays.first == pytest.approx([0.002, 0.003])
    assert delays.overtaken == []
    assert [sum(parts) for parts in delays.parts] == pytest.approx(delays.first)
    assert delays.parts[1] == pytest.approx((0.0005, 0.0005, 0.002))


def test_a_setpoint_is_overtaken_from_a_millisecond_on() -> None:
    used = [(1.0, 1, 0.9901)]
    for late_s, overtaken in ((0.0009, []), (0.0011, [(1.002, 1.0031)])):
        odometry = [(1, 0.99), (2, 1.002)]
        assert delays_of([(1.002 + late_s, 0.5)], used, odometry).overtaken == overtaken


def flight(*at_s: float) -> Figures:
    """A log of setpoints at these times, each from ODOMETRY of 1 ms before."""
    return {
        "odometry": [(number, t - 0.001) for number, t in enumerate(at_s, 1)],
        "setpoints": [(t, 0.3 + 1e-4 * number) for number, t in enumerate(at_s, 1)],
    }


@pytest.mark.parametrize(
    ("still", "own"),
    [
        ([], 3),  # the machine ran: the client's own
        ([(1.011, 1.050)], 0),  # 39 of the 40 ms are explained
        ([(1.011, 1.0305)], 1),  # a gap of 20.5 ms is left: one setpoint
        ([(1.0105, 1.0117)], 3),  # hardly anything
        ([(1.0105, 1.0265)], 1),  # 24 ms are left
        ([(1.0105, 1.0367)], 0),  # 13.8 ms are left: late, not missing
        ([(0.950, 1.0101), (1.0499, 1.2)], 3),  # before and after
        ([(1.011, 1.021), (1.029, 1.049)], 0),
    ],
)
def test_missing_while_a_core_stood_still_is_not_the_clients_own(still: list[tuple[float, float]], own: int) -> None:
    figures = figures_of(said(from_s=1.0, to_s=1.065), flight(1.0, 1.01, 1.05, 1.06), 0.01, still)
    assert figures["missing"] == 3
    assert figures["missing_own"] == own


def test_a_late_setpoint_is_not_missing_and_none_at_the_end_are() -> None:
    assert figures_of(said(from_s=1.0, to_s=1.05), flight(1.0, 1.018, 1.02, 1.03, 1.04), 0.01)["missing"] == 0
    assert figures_of(said(from_s=1.0, to_s=2.0), flight(1.0, 1.01), 0.01)["missing"] == 98


def test_overtaken_while_a_core_stood_still_is_not_the_clients_own() -> None:
    log = {"odometry": [(1, 1.000), (2, 1.010)], "setpoints": [(1.015, 0.3001)]}
    for still, own in (([], 1), ([(1.0105, 1.0148)], 0), ([(1.012, 1.014)], 1), ([(1.000, 1.0095)], 1)):
        figures = figures_of(said(), log, 0.01, still)
        assert (figures["overtaken"], figures["overtaken_own"]) == (1, own)


def test_how_long_a_core_stood_still_is_counted_within_the_flight() -> None:
    still = [(-1.0, 0.002), (5.0, 5.004), (9.99, 12.0)]
    figures = figures_of(said(), flight(1.0, 1.01), 0.01, still)
    assert figures["still_ms"] == pytest.approx(2.0 + 4.0 + 10.0)
    assert figures["still_max_ms"] == pytest.approx(10.0)
    assert "still_ms" not in figures_of(said(), flight(1.0, 1.01), 0.01)


def test_what_is_missing_is_told_with_what_explains_it() -> None:
    of = said(from_s=1.0, to_s=1.06)
    gap, whole = flight(1.0, 1.01, 1.05, 1.06), flight(*(1.0 + 0.01 * n for n in range(7)))
    told = loop_report.table({"flightd": figures_of(of, gap, 0.01, [(1.01, 1.05)])})
    assert (
        "setpoints missing: 3, overtaken: 0; a core stood still for 40 ms, at most 40 in one go: without that 0" in told
    )
    assert (
        "setpoints missing: 3, overtaken: 0\n" in loop_report.table({"flightd": figures_of(of, gap, 0.01, [])}) + "\n"
    )
    assert "could not be watched" in loop_report.table({"flightd": figures_of(of, gap, 0.01)})
    assert "missing" not in loop_report.table({"flightd": figures_of(of, whole, 0.01, [])})


def test_what_one_round_could_not_watch_is_left_out() -> None:
    watched, unwatched = (figures_of(said(), flight(1.0, 1.01), 0.01, still) for still in ([], None))
    for rounds in ([watched, unwatched], [unwatched, watched]):
        merged = over_rounds(rounds)
        assert "still_ms" not in merged
        assert merged["setpoints"] == 4


def test_memory_has_a_slope_by_the_hour() -> None:
    figures = figures_of(
        said(memory=[(float(t), 100.0 + t / 1800.0) for t in range(61)]),
        {"odometry": [(1, 1.0)], "setpoints": [(1.5, 0.3001)]},
        0.01,
    )
    assert figures["rss_slope_mb_h"] == pytest.approx(2.0)
    assert (figures["rss_first_mb"], figures["rss_last_mb"]) == pytest.approx((100.0, 100.0 + 60.0 / 1800.0))
    assert "memory" not in figures


def test_over_rounds_counts_add_up_and_the_rest_are_medians() -> None:
    rounds: list[Figures] = [
        {"rounds": 1, "missed": missed, "cpu_pct": cpu, "period_max_ms": most, "collections": {"generation 0": 2}}
        for missed, cpu, most in ((0, 5.0, 12.0), (3, 7.0, 19.0), (0, 6.0, 11.0))
    ]
    merged = {"rounds": 3, "missed": 3, "cpu_pct": 6.0, "period_max_ms": 19.0, "collections": {"generation 0": 6}}
    assert over_rounds(rounds) == merged
    assert over_rounds([{"error": "broken"}, *rounds]) == merged | {"failed": 1, "failure": "broken"}
    assert over_rounds([{"error": "broken"}]) == {"error": "broken"}


def test_a_ratio_is_to_the_client_of_the_same_run() -> None:
    flights = {"flightd, recording": {"cpu_pct": 6.0}, "asyncio API": {"cpu_pct": 8.0}}
    before = {"flights": {"flightd, recording": {"cpu_pct": 4.0}, "asyncio API": {"cpu_pct": 8.0}}}
    assert loop_report.ratios(flights) == {"CPU, recording / asyncio API": 0.75}
    assert loop_report.compared(flights, before).splitlines()[1].split()[-3:] == ["0.75", "1.0", "0.50"]
    assert loop_report.compared(flights, None).splitlines()[1].split()[-3:] == ["0.75", "1.0", "-"]
    assert loop_report.compared({"flightd": {"cpu_pct": 6.0}}, before) == ""


def test_the_table_names_what_failed_and_what_was_refused() -> None:
    log = {"odometry": [(1, 1.0)], "setpoints": [(1.5, 0.3001), (1.51, 0.3001)]}
    flown = figures_of(said(fifo=0, from_s=1.49, to_s=1.52), log, 0.01, []) | {"failed": 2, "failure": "no autopilot"}
    lines = loop_report.table({"C, SCHED_FIFO": flown, "mavsdk-grpc": {"error": "skipped: not here"}}).splitlines()
    assert lines[2].split()[:4] == ["C,", "SCHED_FIFO", "10.00", "0.00"]
    assert lines[3] == "mavsdk-grpc     skipped: not here"
    assert lines[-3:] == [
        "C, SCHED_FIFO:",
        "  SCHED_FIFO was refused",
        "  2 more rounds failed: no autopilot",
    ]


def test_a_client_that_is_held_on_a_core_may_use_that_one_alone() -> None:
    cores = {flight.name: flight.cores for flight in loop.programme(100.0, None)}
    last = {max(os.sched_getaffinity(0))}
    assert cores["flightd, recording, real time"] == cores["asyncio API, one core"] == last
    assert cores["flightd"] == os.sched_getaffinity(0)


def test_every_flight_of_the_programme_has_a_name_of_its_own() -> None:
    flights = loop.programme(125.0, "python")
    assert len({flight.name for flight in flights}) == len(flights)
    rates = {flight.name: flight.rate_hz for flight in flights if not flight.client}
    assert rates["flightd"] == rates["flightd, loaded"] == 125.0
    assert rates["flightd, 250 Hz"] == 250.0


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
