from math import hypot
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from daemon.autopilot.port import Command
from daemon.control.parameters import ControlParameters
from daemon.latest import Latest
from daemon.messages import AutopilotStatus, FlightMode, Imu, Odometry, Setpoint
from daemon.tuning.pulsed import PulsedAutopilot
from daemon.tuning.pulses import Axis, Pulse

LAW = Setpoint((0.02, -0.01, 0.0), 0.5)
PULSE = Pulse(Axis.ROLL, 0.0, 0.5, 0.2, 1.0)
PARAMETERS = ControlParameters()


class Wire:
    def __init__(self) -> None:
        self.odometry: Latest[Odometry | None] = Latest(None)
        self.imu: Latest[Imu | None] = Latest(None)
        self.status = Latest(AutopilotStatus())
        self.clock: Latest[Any] = Latest(None)
        self.slow_streams: Latest[tuple[str, ...]] = Latest(())
        self.setpoints: list[Setpoint] = []
        self.up = True

    async def run(self) -> None: ...

    async def close(self) -> None: ...

    def send_setpoint(self, setpoint: Setpoint) -> bool:
        self.setpoints.append(setpoint)
        return self.up

    def request_mode(self, mode: FlightMode) -> bool:
        return True

    async def command(self, command: Command, timeout_s: float) -> None: ...

    def withdraw_commands(self) -> None: ...

    def stood_still(self) -> None: ...

    async def read_parameter(self, name: str, timeout_s: float) -> float | int | None:
        return None


class Bench:
    def __init__(self, pulse: Pulse = PULSE) -> None:
        self.now_s, self.wire = 100.0, Wire()
        self.pulsed = PulsedAutopilot(self.wire, PARAMETERS, lambda: self.now_s)
        self.pulsed.begin((pulse,))

    def tick(self, setpoint: Setpoint = LAW, permit: bool = True) -> Setpoint:
        self.now_s += 0.01
        if permit:
            self.pulsed.permit(self.now_s + 0.03)
        self.pulsed.send_setpoint(setpoint)
        return self.wire.setpoints[-1]


def test_without_permission_a_setpoint_leaves_as_it_came() -> None:
    assert Bench().tick(permit=False) is LAW


def test_with_permission_the_pulse_is_added() -> None:
    bench = Bench()
    bench.tick()
    assert abs(bench.tick().rates_frd_rad_s[0] - 0.52) < 1e-9


def test_a_permission_that_nobody_renews_runs_out() -> None:
    bench = Bench()
    bench.tick()
    assert [bench.tick(permit=False) is LAW for _ in range(5)] == [False, False, True, True, True]


def test_a_permission_taken_back_counts_at_once() -> None:
    bench = Bench()
    bench.tick()
    bench.pulsed.permit(float("-inf"))
    assert bench.tick(permit=False) is LAW


def test_what_left_is_noted_with_its_pulse_and_what_did_not_leave_is_not() -> None:
    bench = Bench()
    bench.tick()
    bench.tick()
    assert [sent.setpoint for sent in bench.pulsed.sent] == bench.wire.setpoints
    assert bench.pulsed.sent[-1].time_s == bench.now_s
    bench.wire.up = False
    bench.tick()
    assert len(bench.pulsed.sent) == 2


@settings(deadline=None)
@given(
    st.sampled_from(list(Axis)),
    st.floats(-30.0, 30.0),
    st.lists(st.tuples(*[st.floats(-4.0, 4.0)] * 3, st.floats(0.0, 1.0)), min_size=2, max_size=20),
)
def test_a_pulsed_setpoint_keeps_all_limits(
    axis: Axis, size: float, law: list[tuple[float, float, float, float]]
) -> None:
    bench = Bench(Pulse(axis, 0.0, size, 0.05, 1.0))
    before: Setpoint | None = None
    for x, y, z, thrust in law:
        sent = bench.tick(Setpoint((x, y, z), thrust))
        rx, ry, rz = sent.rates_frd_rad_s
        assert hypot(rx, ry) <= PARAMETERS.rate_max_rad_s + 1e-9
        assert abs(rz) <= PARAMETERS.yaw_rate_max_rad_s + 1e-9
        assert PARAMETERS.thrust_min <= sent.thrust <= PARAMETERS.thrust_max
        if before is not None:
            step = hypot(rx - before.rates_frd_rad_s[0], ry - before.rates_frd_rad_s[1])
            assert step <= PARAMETERS.rate_slew_max_rad_s2 * 0.01 + 1e-6
            assert abs(sent.thrust - before.thrust) <= PARAMETERS.thrust_slew_max_1_s * 0.01 + 1e-6
        before = sent
