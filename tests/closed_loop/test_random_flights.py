"""Requests, goals, pilots and faults at random moments of a flight: what holds at every tick, and at its end."""

import asyncio
import os
from collections.abc import Callable
from dataclasses import dataclass, field
from math import hypot, isfinite, radians
from random import Random
from typing import Any

import pytest
from support.flight import CALLER, Flight, fly

from daemon.goals.errors import ProtocolError
from daemon.goals.methods import NoParams, Takeoff
from daemon.messages import FlightMode, RequestKind, Setpoint
from daemon.pipeline import Inputs, Record
from daemon.safety.conditions import LANDING_MODES, PILOT_MODES
from daemon.safety.supervisor import OURS, State
from daemon.sim.fault import Fault
from daemon.sim.faults import (
    BatteryLow,
    EkfReset,
    GpsLoss,
    Link,
    ModesRefused,
    PilotTakesOver,
    StoppedTelemetry,
    WindGust,
)
from daemon.sim.modes import MANUAL_MODES

SEED = int(os.environ.get("FLIGHTD_SEED", "30"))
FLIGHT_S = 240.0
REQUESTS = ("arm", "disarm", "takeoff", "engage", "engage", "hold", "hold", "land", "return")
PILOTS = (*sorted(mode.value for mode in MANUAL_MODES), "hold", "hold", "return", "land", "mission")
ANSWERED_WITHIN_S = {"takeoff": 80.0, "land": 250.0, "return": 700.0}
SETTLES_S = 2.5  # a bad link, and a hand-over into it, are over
SHOWS_S = 0.12  # a mode on a good link
MODE_COMMANDS = (20, 21, 22, 176)


def a_fault(rng: Random) -> Fault:
    u = rng.uniform
    either = rng.choice(("up", "down", "both"))
    made: tuple[Callable[[], Fault], ...] = (
        lambda: Link(direction=either, silent=True, duration_s=rng.choice((u(0.0, 0.4), u(0.3, 1.5), u(1.0, 4.0)))),
        lambda: Link(
            direction=either, delay_s=u(0.0, 0.3), loss=u(0.0, 0.3), jitter_s=u(0.0, 0.1), duration_s=u(0.5, 5)
        ),
        lambda: StoppedTelemetry(duration_s=rng.choice((u(0.0, 0.3), u(0.3, 2.0)))),
        lambda: EkfReset(
            kind=rng.choice(("position_ne", "position_d", "heading")), size_m=u(-4, 4), size_deg=u(-40, 40)
        ),
        lambda: GpsLoss(duration_s=rng.choice((u(0.1, 2.0), u(2.0, 12.0)))),
        lambda: WindGust(north_m_s=u(-8, 8), east_m_s=u(-8, 8), duration_s=u(0.5, 3.0)),
        lambda: BatteryLow(fraction=rng.choice((0.14, 0.065, 0.04)), duration_s=u(0.5, 8.0)),
        lambda: ModesRefused(
            modes=tuple(rng.sample(("offboard", "hold", "land", "return"), 2)), duration_s=u(0.2, 3.0)
        ),
    )
    return rng.choice(made)()


@dataclass
class RandomFlight:
    """Who does what to the vehicle, and what was seen that must not be."""

    flight: Flight
    rng: Random
    faults: bool
    wrong: list[tuple[Any, ...]] = field(default_factory=list)
    waiting: dict["asyncio.Task[None]", tuple[float, str]] = field(default_factory=dict)
    goals: list[str] = field(default_factory=list)
    answers: int = 0
    engaged: int = 0
    clean_from_s: float = 0.0
    piloted_from_s: float | None = None
    stale_ticks: int = 0
    odd: tuple[str, float] | None = None
    state: State | None = None

    def __post_init__(self) -> None:
        self._receive = self.flight.px4.receive
        self.flight.px4.receive = self._on_receive  # type: ignore[method-assign]
        self.flight.vehicle.control.listeners.append(self._on_tick)

    @property
    def is_clean(self) -> bool:
        """The link is good, and has been for a while."""
        return self.flight.now_s > self.clean_from_s

    def see(self, what: str, *more: object) -> None:
        self.wrong.append((round(self.flight.now_s, 2), what, *more))

    def _on_receive(self, name: str, fields: Any, **sender: Any) -> None:
        px4 = self.flight.px4
        piloted_s = 0.0 if self.piloted_from_s is None else self.flight.now_s - self.piloted_from_s
        flies = px4.armed and px4.mode in PILOT_MODES and not px4.commander.failsafe.flown
        flies = flies and piloted_s > SHOWS_S and self.is_clean and not px4.commander.detector.landed
        if flies and name == "COMMAND_LONG" and int(fields["command"]) in MODE_COMMANDS:
            self.see("a mode was commanded while a pilot flies", px4.mode.value)
        self._receive(name, fields, **sender)

    def _on_tick(self, inputs: Inputs, record: Record) -> None:
        px4, state, mode = self.flight.px4, record.supervision.state, inputs.status.mode
        if px4.mode not in PILOT_MODES:
            self.piloted_from_s = None
        elif self.piloted_from_s is None:
            self.piloted_from_s = record.now_s
        if state is State.ENGAGING and self.state is not State.ENGAGING:
            self.engaged += 1
            if inputs.request is None or inputs.request.kind is not RequestKind.ENGAGE:
                self.see("engaged against the newest request")
        self.state = state
        if record.setpoint is not None:
            self._judge_setpoint(record.setpoint, state, mode)
        self._judge_state(inputs, state, record.now_s)

    def _judge_setpoint(self, setpoint: Setpoint, state: State, mode: FlightMode) -> None:
        limits, (roll, pitch, yaw) = self.flight.vehicle.config.control, setpoint.rates_frd_rad_s
        if not (
            all(map(isfinite, (roll, pitch, yaw, setpoint.thrust)))
            and hypot(roll, pitch) <= radians(limits.rate_max_deg_s) + 1e-9
            and abs(yaw) <= radians(limits.yaw_rate_max_deg_s) + 1e-9
            and limits.thrust_min <= setpoint.thrust <= limits.thrust_max
        ):
            self.see("not within limits", setpoint.rates_frd_rad_s, setpoint.thrust)
        mine = mode is FlightMode.OFFBOARD or (state in (State.ENGAGING, State.RELEASING) and mode is FlightMode.HOLD)
        self.stale_ticks = 0 if mine else self.stale_ticks + 1
        if self.stale_ticks > 2:
            self.see("a setpoint in a mode that is not ours", mode.value, state.value)
        piloted_s = 0.0 if self.piloted_from_s is None else self.flight.now_s - self.piloted_from_s
        if self.is_clean and piloted_s > SHOWS_S:
            self.see("a setpoint while a pilot flies", state.value)

    def _judge_state(self, inputs: Inputs, state: State, now_s: float) -> None:
        """What cannot last on a good link."""
        mode, armed, odd = inputs.status.mode, inputs.status.armed, None
        if self.is_clean and inputs.status.connected:
            on_ground = self.flight.px4.commander.detector.landed
            odd = next(
                (
                    name
                    for name, is_so in (
                        ("ready in another mode", state is State.READY and mode is not FlightMode.HOLD),
                        (
                            "landing in another mode",
                            state is State.LANDING and mode not in LANDING_MODES and not on_ground,
                        ),
                        (
                            "offboard, and nobody flies",
                            mode is FlightMode.OFFBOARD and state not in OURS and not on_ground,
                        ),
                        ("disarmed", not armed and state is not State.STANDBY),
                        ("standby in the air", armed and state is State.STANDBY and not on_ground),
                        ("passing", state in (State.ENGAGING, State.RELEASING, State.DISCONNECTED)),
                        ("a goal and no vehicle", self._has_goal and state in (State.STANDBY, State.LANDING)),
                    )
                    if is_so
                ),
                None,
            )
        if odd is None or self.odd is None or self.odd[0] != odd:
            self.odd = None if odd is None else (odd, now_s)
        elif now_s - self.odd[1] > SETTLES_S:
            self.see(odd, state.value, mode.value)
            self.odd = (odd, now_s + FLIGHT_S)

    @property
    def _has_goal(self) -> bool:
        return self.flight.vehicle.trajectory.goal_id is not None

    async def _request(self, name: str) -> None:
        try:
            if name == "goal":
                place = [self.rng.uniform(-20, 20), self.rng.uniform(-20, 20), self.rng.uniform(-14, -4)]
                self.goals.append(await self.flight.submit(waypoint={"position": place}))
            elif name == "takeoff":
                await self.flight.service.vehicle_takeoff(Takeoff(altitude_m=self.rng.uniform(3, 15)), CALLER)
            else:
                await getattr(self.flight.service, f"vehicle_{name}")(NoParams(), CALLER)
        except ProtocolError:
            pass
        except Exception as error:  # noqa: BLE001 - a fault of the daemon's is what this looks for
            self.see("not answered but failed", name, repr(error))
        self.answers += 1

    def ask(self, name: str) -> None:
        task = asyncio.ensure_future(self._request(name))
        self.waiting[task] = (self.flight.now_s, name)
        task.add_done_callback(self.waiting.pop)

    def pilot(self, mode: str) -> None:
        self.flight.px4.inject(PilotTakesOver(mode=mode))

    def act(self) -> None:
        rng, px4, state = self.rng, self.flight.px4, self.state
        chance = rng.random()
        if px4.commander.detector.landed and not px4.armed and chance < 0.7:
            self.ask("takeoff")
        elif state in (State.PILOT, State.FAULT) and chance < 0.4:
            self.pilot("hold") if px4.mode is not FlightMode.HOLD else self.ask("engage")
        elif chance < 0.6:
            self.ask(rng.choice(("goal", "goal", *REQUESTS)))
        elif chance < 0.75:
            self.pilot(rng.choice(PILOTS))
        elif self.faults:
            fault = a_fault(rng)
            self.clean_from_s = max(self.clean_from_s, self.flight.now_s + (fault.duration_s or 0.0) + SETTLES_S)
            px4.inject(fault)

    async def run(self) -> None:
        flight, rng = self.flight, self.rng
        await flight.until(lambda: flight.state is State.STANDBY and flight.records[-1].estimate.newest is not None)
        while flight.now_s < FLIGHT_S:
            self.act()
            await asyncio.sleep(rng.choice((0.0, rng.uniform(0, 0.05), rng.uniform(0, 0.3), rng.uniform(0, 3))))
            for since_s, name in self.waiting.values():
                if flight.now_s - since_s > ANSWERED_WITHIN_S.get(name, 12.0):
                    self.see("no answer", name)
        flight.px4.faults.clear()
        await asyncio.sleep(5.0)
        await flight.vehicle.release()
        if flight.state in OURS:
            self.see("ours after the release")


@pytest.mark.parametrize("faults", [False, True])
@pytest.mark.parametrize("number", range(2))
def test_whatever_happens_at_whatever_moment_pilots_limits_and_answers_are_kept(number: int, faults: bool) -> None:
    async def scenario(flight: Flight) -> None:
        seen = RandomFlight(flight, Random(SEED + number), faults)
        await seen.run()
        assert seen.wrong == []
        assert [entry.goal_id for entry in flight.ended] == seen.goals, "each goal ends once, in order"
        assert seen.answers > 50
        assert seen.engaged > 5

    fly(scenario, seed=SEED + number, noise=True)
