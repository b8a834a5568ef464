"""Vehicle requests against a scripted autopilot: what is asked, what is waited for, and each refusal in words."""

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import replace
from typing import Any

import pytest
from support.trajectory_rig import NOTHING

from daemon.autopilot.port import Command, CommandKind, CommandRefusedError, CommandTimeoutError
from daemon.latest import Latest
from daemon.loops.commander import Commander, CommandTimeouts, NotPossibleError
from daemon.messages import (
    IDENTITY,
    ZERO3,
    AutopilotStatus,
    EstimatedState,
    FlightMode,
    GlobalPosition,
    LandedState,
    ModeRefusal,
    RequestKind,
    Setpoint,
    SystemStatus,
    VehicleRequest,
)
from daemon.pipeline import Record
from daemon.safety.dead_man import SetpointGate
from daemon.safety.supervisor import State
from daemon.sim.virtual_time import run_virtual

GROUND = AutopilotStatus(
    connected=True,
    mode=FlightMode.HOLD,
    intended_mode=FlightMode.HOLD,
    armed=False,
    landed=LandedState.ON_GROUND,
    system_status=SystemStatus.STANDBY,
    global_position=GlobalPosition(47.0, 8.0, 500.0),
)
AIR = replace(GROUND, armed=True, landed=LandedState.IN_AIR, system_status=SystemStatus.ACTIVE)
AT_TEN_METRES = EstimatedState(0.0, (0.0, 0.0, -10.0), ZERO3, IDENTITY, ZERO3)
TIMEOUTS = CommandTimeouts()


class Vehicle:
    """Autopilot and supervisor in one: answers by ``script``, which is called with each command and request."""

    def __init__(self, status: AutopilotStatus, state: State) -> None:
        self.status: Latest[AutopilotStatus] = Latest(status)
        self.record: Latest[Record | None] = Latest(None)
        self.request: Latest[VehicleRequest | None] = Latest(None)
        self.asked: list[CommandKind | RequestKind] = []
        self.altitude_amsl_m: float | None = None
        self.script: Callable[[CommandKind | RequestKind], None] = lambda _asked: None
        self.gate = SetpointGate(self, lambda: 0.0)
        self.commander = Commander(self, self.gate, self.record, self.request, TIMEOUTS)  # type: ignore[arg-type]
        self.set(state)

    def set(self, state: State, reason: str = "requested", **status: Any) -> None:
        """What telemetry and the supervisor show from now on."""
        self.status.set(replace(self.status.value, **status))
        conditions = replace(NOTHING.conditions, state_usable=True, estimate_poor=False)
        supervision = replace(NOTHING.supervision, state=state, reason=reason)
        estimate = replace(NOTHING.estimate, newest=AT_TEN_METRES)
        self.record.set(replace(NOTHING, supervision=supervision, conditions=conditions, estimate=estimate))

    def later(self, delay_s: float, state: State, reason: str = "requested", **status: Any) -> None:
        asyncio.get_running_loop().call_later(delay_s, lambda: self.set(state, reason, **status))

    def see(self, **conditions: bool) -> None:
        record = self.record.value
        assert record is not None
        self.record.set(replace(record, conditions=replace(record.conditions, **conditions)))

    async def command(self, command: Command, timeout_s: float) -> None:
        assert timeout_s == TIMEOUTS.acknowledge_s
        self.altitude_amsl_m = command.altitude_amsl_m
        self._tell(command.kind)

    async def watch(self) -> None:
        """The supervisor, which takes each request once."""
        seen = 0
        while True:
            request = self.request.value
            if request is not None and request.serial != seen:
                assert request.serial == seen + 1
                seen = request.serial
                self._tell(request.kind)
            await asyncio.sleep(0.01)

    def _tell(self, asked: CommandKind | RequestKind) -> None:
        self.asked.append(asked)
        self.script(asked)

    def send_setpoint(self, setpoint: Setpoint) -> bool:
        return True

    def request_mode(self, mode: FlightMode) -> bool:
        return True


Play = Callable[[Vehicle], Awaitable[None]]


def play(scenario: Play, status: AutopilotStatus = GROUND, state: State = State.STANDBY) -> float:
    """Runs it; how long it took in virtual time."""

    async def main() -> float:
        vehicle = Vehicle(status, state)
        watch = asyncio.ensure_future(vehicle.watch())
        try:
            await scenario(vehicle)
        finally:
            watch.cancel()
        return asyncio.get_running_loop().time()

    return run_virtual(main())


def answers(vehicle: Vehicle, replies: dict[CommandKind | RequestKind, Callable[[], None]]) -> None:
    vehicle.script = lambda asked: replies.get(asked, lambda: None)()


def refused(
    match: str,
    status: AutopilotStatus,
    state: State,
    ask: Callable[[Commander], Awaitable[None]],
    error: type[Exception] = NotPossibleError,
) -> None:
    """The request is refused at once, in these words, and nothing is asked of anybody."""

    async def scenario(vehicle: Vehicle) -> None:
        with pytest.raises(error, match=match):
            await ask(vehicle.commander)
        await asyncio.sleep(0.1)
        assert vehicle.asked == []

    assert play(scenario, status, state) < 0.2


def test_arming_is_done_when_telemetry_shows_it() -> None:
    async def scenario(vehicle: Vehicle) -> None:
        answers(vehicle, {CommandKind.ARM: lambda: vehicle.later(0.5, State.STANDBY, armed=True)})
        await vehicle.commander.arm()
        assert vehicle.status.value.armed
        await vehicle.commander.arm()
        assert vehicle.asked == [CommandKind.ARM]

    assert play(scenario) == pytest.approx(0.5, abs=0.05)


def test_disarming_is_done_when_telemetry_shows_it() -> None:
    async def scenario(vehicle: Vehicle) -> None:
        answers(vehicle, {CommandKind.DISARM: lambda: vehicle.later(0.3, State.STANDBY, armed=False)})
        await vehicle.commander.disarm()
        assert vehicle.asked == [CommandKind.DISARM]

    assert play(scenario, replace(GROUND, armed=True)) == pytest.approx(0.3, abs=0.05)


def test_a_take_off_goes_to_hold_arms_and_climbs_to_a_height_above_the_ground() -> None:
    async def scenario(vehicle: Vehicle) -> None:
        def climb() -> None:
            vehicle.later(0.2, State.TAKING_OFF, mode=FlightMode.TAKEOFF)
            vehicle.later(6.0, State.READY, mode=FlightMode.HOLD, landed=LandedState.IN_AIR)

        answers(
            vehicle,
            {
                RequestKind.HOLD: lambda: vehicle.later(0.1, State.STANDBY, mode=FlightMode.HOLD),
                CommandKind.ARM: lambda: vehicle.later(0.1, State.STANDBY, armed=True),
                CommandKind.TAKEOFF: climb,
            },
        )
        await vehicle.commander.takeoff(7.0)
        # The supervisor sees the request at its next tick, the command goes at once.
        assert vehicle.asked[:2] == [RequestKind.HOLD, CommandKind.ARM]
        assert set(vehicle.asked[2:]) == {RequestKind.TAKEOFF, CommandKind.TAKEOFF}
        assert vehicle.altitude_amsl_m == 507.0

    assert play(scenario, replace(GROUND, mode=FlightMode.LAND)) == pytest.approx(6.2, abs=0.2)


def test_a_take_off_that_ends_elsewhere_says_where() -> None:
    async def scenario(vehicle: Vehicle) -> None:
        def taken() -> None:
            vehicle.later(0.2, State.TAKING_OFF)
            vehicle.later(1.0, State.PILOT, "pilot_override")

        answers(vehicle, {CommandKind.TAKEOFF: taken})
        with pytest.raises(CommandRefusedError, match=r"take-off ended in state pilot: pilot_override"):
            await vehicle.commander.takeoff(5.0)

    play(scenario, replace(GROUND, armed=True))


def test_engaging_opens_the_gate_and_is_done_when_the_vehicle_is_ours() -> None:
    async def scenario(vehicle: Vehicle) -> None:
        def engage() -> None:
            vehicle.set(State.ENGAGING)
            vehicle.later(0.4, State.HOLDING, mode=FlightMode.OFFBOARD)

        vehicle.gate.latch()
        answers(vehicle, {RequestKind.ENGAGE: engage})
        await vehicle.commander.engage()
        assert not vehicle.gate.latched
        await vehicle.commander.engage()
        assert vehicle.asked == [RequestKind.ENGAGE]

    assert play(scenario, AIR, State.READY) == pytest.approx(0.4, abs=0.1)


def test_an_engage_that_the_autopilot_refuses_says_why() -> None:
    async def scenario(vehicle: Vehicle) -> None:
        def engage() -> None:
            refusal = ModeRefusal(FlightMode.OFFBOARD, "no offboard signal", 0.1)
            vehicle.set(State.ENGAGING, mode_refusal=refusal)
            vehicle.later(0.5, State.READY, "engage_refused")

        answers(vehicle, {RequestKind.ENGAGE: engage})
        with pytest.raises(CommandRefusedError, match=r"state ready: engage_refused \(no offboard signal\)"):
            await vehicle.commander.engage()

    play(scenario, AIR, State.READY)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"armed": False}, "the vehicle is not armed"),
        ({"landed": LandedState.LANDING}, "landed state is landing"),
        ({"mode": FlightMode.RETURN, "intended_mode": FlightMode.RETURN}, "the mode is return, not hold"),
        ({"intended_mode": FlightMode.OFFBOARD}, "the autopilot intends offboard: a failsafe acts"),
        ({"system_status": SystemStatus.CRITICAL}, "system status is critical"),
    ],
)
def test_engaging_names_what_is_missing(change: dict[str, Any], words: str) -> None:
    refused(f"cannot engage: .*{words}", replace(AIR, **change), State.READY, Commander.engage)


@pytest.mark.parametrize(
    ("conditions", "words"),
    [
        ({"state_usable": False}, "there is no fresh estimate"),
        ({"estimate_poor": True}, "estimate is too uncertain"),
        ({"attitude_disagrees": True}, "attitude and its accelerometer disagree"),
    ],
)
def test_engaging_needs_an_estimate(conditions: dict[str, bool], words: str) -> None:
    async def scenario(vehicle: Vehicle) -> None:
        vehicle.see(**conditions)
        with pytest.raises(NotPossibleError, match=words):
            await vehicle.commander.engage()
        assert vehicle.asked == []

    play(scenario, AIR, State.READY)


@pytest.mark.parametrize(
    ("ask", "status", "state", "words"),
    [
        (Commander.arm, replace(GROUND, connected=False), State.DISCONNECTED, "no autopilot is connected"),
        (Commander.disarm, replace(GROUND, connected=False), State.STANDBY, "no autopilot is connected"),
        (lambda c: c.takeoff(5.0), GROUND, State.DISCONNECTED, "no autopilot is connected"),
        (Commander.engage, replace(AIR, connected=False), State.READY, "no autopilot is connected"),
        (Commander.hold, replace(AIR, connected=False), State.READY, "no autopilot is connected"),
        (Commander.arm, GROUND, State.FAULT, "cannot arm in state fault"),
        (Commander.disarm, AIR, State.READY, "the vehicle is not landed; land it first"),
        (lambda c: c.takeoff(5.0), AIR, State.READY, "needs a vehicle on the ground; the state is ready"),
        (
            lambda c: c.takeoff(5.0),
            replace(GROUND, armed=True, mode=FlightMode.POSITION),
            State.STANDBY,
            "a pilot has armed the vehicle and flies in mode position",
        ),
        (lambda c: c.takeoff(5.0), replace(GROUND, global_position=None), State.STANDBY, "no global position yet"),
        (Commander.engage, GROUND, State.STANDBY, "cannot engage in state standby; take off first"),
        (Commander.hold, GROUND, State.STANDBY, "cannot hold: the vehicle is not in the air"),
        (Commander.land, GROUND, State.STANDBY, "cannot land: the vehicle is not in the air"),
        (Commander.return_home, GROUND, State.STANDBY, "cannot return: the vehicle is not in the air"),
        (Commander.land, replace(AIR, mode=FlightMode.ACRO), State.PILOT, "a pilot flies in mode acro"),
        (Commander.hold, replace(AIR, mode=FlightMode.POSITION), State.PILOT, "a pilot flies in mode position"),
    ],
)
def test_what_does_not_fit_the_state_is_refused_in_words(
    ask: Callable[[Commander], Awaitable[None]], status: AutopilotStatus, state: State, words: str
) -> None:
    refused(words, status, state, ask)


def test_hold_is_done_when_the_supervisor_has_let_go() -> None:
    async def scenario(vehicle: Vehicle) -> None:
        def hold() -> None:
            vehicle.later(0.1, State.RELEASING, mode=FlightMode.HOLD)
            vehicle.later(0.2, State.READY)

        answers(vehicle, {RequestKind.HOLD: hold})
        await vehicle.commander.hold()
        assert vehicle.commander.state is State.READY

    assert play(scenario, replace(AIR, mode=FlightMode.OFFBOARD), State.HOLDING) == pytest.approx(0.2, abs=0.05)


@pytest.mark.parametrize(
    ("ask", "kind", "mode"),
    [
        (Commander.land, RequestKind.LAND, FlightMode.LAND),
        (Commander.return_home, RequestKind.RETURN, FlightMode.RETURN),
    ],
)
def test_coming_down_is_done_when_disarmed(
    ask: Callable[[Commander], Awaitable[None]], kind: RequestKind, mode: FlightMode
) -> None:
    async def scenario(vehicle: Vehicle) -> None:
        def down() -> None:
            vehicle.later(0.1, State.LANDING, mode=mode)
            vehicle.later(30.0, State.LANDING, landed=LandedState.ON_GROUND)
            vehicle.later(32.0, State.STANDBY, armed=False)

        answers(vehicle, {kind: down})
        await ask(vehicle.commander)
        assert vehicle.commander.state is State.STANDBY

    assert play(scenario, AIR, State.READY) == pytest.approx(32.0, abs=0.1)


def test_a_landing_that_a_pilot_ends_says_so() -> None:
    async def scenario(vehicle: Vehicle) -> None:
        def down() -> None:
            vehicle.later(0.1, State.LANDING, mode=FlightMode.LAND)
            vehicle.later(3.0, State.PILOT, "pilot_override", mode=FlightMode.POSITION)

        answers(vehicle, {RequestKind.LAND: down})
        with pytest.raises(NotPossibleError, match="land ended in state pilot: pilot_override"):
            await vehicle.commander.land()

    assert play(scenario, AIR, State.READY) == pytest.approx(3.0, abs=0.1)


def test_a_mode_that_the_autopilot_refuses_is_told_in_its_words() -> None:
    async def scenario(vehicle: Vehicle) -> None:
        def no() -> None:
            now_s = asyncio.get_running_loop().time()
            vehicle.set(State.READY, mode_refusal=ModeRefusal(FlightMode.LAND, "no position", now_s))

        answers(vehicle, {RequestKind.LAND: no})
        with pytest.raises(CommandRefusedError, match="the autopilot refused land: no position"):
            await vehicle.commander.land()

    assert play(scenario, AIR, State.READY) < 0.2


def test_a_refusal_from_before_the_request_is_not_held_against_it() -> None:
    async def scenario(vehicle: Vehicle) -> None:
        await asyncio.sleep(1.0)
        vehicle.set(State.READY, mode_refusal=ModeRefusal(FlightMode.LAND, "no position", 0.5))
        with pytest.raises(CommandTimeoutError):
            await vehicle.commander.land()

    play(scenario, AIR, State.READY)


@pytest.mark.parametrize(
    ("ask", "status", "state", "limit_s", "words"),
    [
        (Commander.arm, GROUND, State.STANDBY, TIMEOUTS.arm_s, "not armed after 3 s; it may still come"),
        (Commander.disarm, replace(GROUND, armed=True), State.STANDBY, TIMEOUTS.arm_s, "not disarmed after 3 s"),
        (lambda c: c.takeoff(5.0), replace(GROUND, armed=True), State.STANDBY, TIMEOUTS.mode_s, "not taking off"),
        (Commander.engage, AIR, State.READY, 0.5, "not engaging after 0.5 s"),
        (Commander.engage, AIR, State.ENGAGING, TIMEOUTS.engage_s, "not engaged after 3 s"),
        (
            Commander.hold,
            replace(AIR, mode=FlightMode.MISSION),
            State.READY,
            TIMEOUTS.mode_s,
            "not in mode hold after 2.5 s",
        ),
        (Commander.hold, AIR, State.RELEASING, TIMEOUTS.mode_s, "not released after 2.5 s"),
        (Commander.hold, AIR, State.TAKING_OFF, TIMEOUTS.mode_s, "not in Hold after 2.5 s"),
        (Commander.land, AIR, State.READY, TIMEOUTS.mode_s, "not in mode land after 2.5 s"),
        (
            Commander.land,
            replace(AIR, mode=FlightMode.LAND),
            State.LANDING,
            TIMEOUTS.land_s + 10.0 / TIMEOUTS.descend_m_s,
            "not landed and disarmed",
        ),
        (
            lambda c: c.takeoff(10.0),
            replace(GROUND, armed=True),
            State.TAKING_OFF,
            TIMEOUTS.takeoff_s + 10.0 / TIMEOUTS.climb_m_s,
            "not in the air",
        ),
    ],
)
def test_every_wait_is_bounded(
    ask: Callable[[Commander], Awaitable[None]], status: AutopilotStatus, state: State, limit_s: float, words: str
) -> None:
    async def scenario(vehicle: Vehicle) -> None:
        if state is State.TAKING_OFF and status.landed is LandedState.ON_GROUND:  # it begins on the ground
            vehicle.set(State.STANDBY)
            vehicle.script = lambda _asked: vehicle.set(State.TAKING_OFF)
        with pytest.raises(CommandTimeoutError, match=words):
            await ask(vehicle.commander)

    assert play(scenario, status, state) == pytest.approx(limit_s, abs=0.1)


def test_a_newer_request_ends_a_pending_one() -> None:
    async def scenario(vehicle: Vehicle) -> None:
        landing = asyncio.ensure_future(vehicle.commander.land())
        await asyncio.sleep(0.5)
        answers(vehicle, {RequestKind.HOLD: lambda: vehicle.later(0.1, State.READY, mode=FlightMode.HOLD)})
        await vehicle.commander.hold()
        with pytest.raises(NotPossibleError, match="superseded by a newer vehicle request"):
            await landing
        assert vehicle.asked == [RequestKind.LAND, RequestKind.HOLD]

    assert play(scenario, replace(AIR, mode=FlightMode.MISSION), State.READY) < 1.0


def test_a_request_that_is_refused_at_once_ends_none() -> None:
    async def scenario(vehicle: Vehicle) -> None:
        answers(vehicle, {RequestKind.LAND: lambda: vehicle.later(1.0, State.LANDING, mode=FlightMode.LAND)})
        landing = asyncio.ensure_future(vehicle.commander.land())
        await asyncio.sleep(0.5)
        for ask in (vehicle.commander.disarm(), vehicle.commander.takeoff(5.0)):
            with pytest.raises(NotPossibleError):
                await ask
        vehicle.later(2.0, State.STANDBY, armed=False)
        await landing

    play(scenario, AIR, State.READY)


def test_an_acknowledgement_that_comes_after_a_newer_request_does_not_count() -> None:
    async def scenario(vehicle: Vehicle) -> None:
        async def slowly(_command: Command, _timeout_s: float) -> None:
            await asyncio.sleep(1.0)
            raise CommandRefusedError("no")

        vehicle.command = slowly  # type: ignore[method-assign]
        arming = asyncio.ensure_future(vehicle.commander.arm())
        await asyncio.sleep(0.5)
        newer = asyncio.ensure_future(vehicle.commander.arm())
        with pytest.raises(NotPossibleError, match="superseded"):
            await arming
        with pytest.raises(CommandRefusedError, match="no"):
            await newer

    play(scenario)


def test_a_release_under_way_is_let_end_before_another_mode_is_asked() -> None:
    async def scenario(vehicle: Vehicle) -> None:
        vehicle.later(0.4, State.READY, mode=FlightMode.HOLD)
        landing = asyncio.ensure_future(vehicle.commander.land())
        await asyncio.sleep(0.3)
        assert vehicle.asked == []
        await asyncio.sleep(0.2)
        assert vehicle.asked == [RequestKind.LAND]
        landing.cancel()

    play(scenario, replace(AIR, mode=FlightMode.OFFBOARD), State.RELEASING)


def test_a_daemon_that_stops_engages_no_more() -> None:
    async def scenario(vehicle: Vehicle) -> None:
        vehicle.commander.stopping = True
        with pytest.raises(NotPossibleError, match="the daemon is stopping"):
            await vehicle.commander.engage()

    play(scenario, AIR, State.READY)


def test_an_engage_for_a_goal_ends_with_the_goal() -> None:
    async def scenario(vehicle: Vehicle) -> None:
        wanted = [True]
        engage = asyncio.ensure_future(vehicle.commander.engage_pending(lambda: wanted[0]))
        answers(vehicle, {RequestKind.ENGAGE: lambda: vehicle.set(State.ENGAGING)})
        await asyncio.sleep(0.3)
        wanted[0] = False
        with pytest.raises(NotPossibleError, match="superseded"):
            await engage

    assert play(scenario, AIR, State.READY) < 0.5


def test_without_a_record_nothing_is_connected() -> None:
    async def scenario(vehicle: Vehicle) -> None:
        vehicle.record.set(None)
        assert vehicle.commander.state is State.DISCONNECTED
        with pytest.raises(NotPossibleError, match="no autopilot is connected"):
            await vehicle.commander.arm()

    play(scenario)
