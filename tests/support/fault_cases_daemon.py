"""Rows of the fault matrix: the daemon's own tasks, its machine, requests that are refused, and the fence."""

import time
from contextlib import ExitStack
from typing import Any
from unittest import mock

import pytest

from daemon.autopilot.port import CommandRefusedError
from daemon.goals.errors import ProtocolError
from daemon.loops.turns import NotPossibleError
from daemon.messages import FlightMode
from daemon.safety.supervisor import State
from daemon.sim.faults import ArmingRefused, ModesRefused, SteadyWind, WindGust
from support.fault_matrix import Case, Deed, Start
from support.flight import Flight

HOLD = FlightMode.HOLD
HOUR_S = 3600.0
FENCE_M = 20.0


class DeliberateError(RuntimeError):
    """What a task is let die of."""


def _die(*_arguments: Any) -> None:
    raise DeliberateError


def _tasks() -> list[Case]:
    dead: dict[str, Any] = {
        "ends": True,
        "outcome": "aborted",
        "mode": HOLD,
        "silent_s": 0.3,
        "hold_s": 0.3,
        "words": "Hold within 0.3 s, the goal `aborted`, the daemon ends with code 1",
    }
    return [
        Case(
            name="trajectory task dies", do=_kill_trajectory, state=State.READY, left="requested", asked=(HOLD,), **dead
        ),
        Case(name="health task dies", do=_kill_health, state=State.READY, left="requested", asked=(HOLD,), **dead),
        Case(name="control task dies", do=_kill_control, state=State.TRACKING, **dead),
        Case(name="link task dies", do=_kill_link, state=State.READY, left="requested", asked=(HOLD,), **dead),
        Case(
            name="trajectory task stalls",
            do=_stall_trajectory,
            state=State.TRACKING,
            outcome="",
            starves=True,
            watch_s=8.0,
            words="brakes to a hover; the watchdog is no longer fed",
        ),
    ]


def _kill_trajectory(flight: Flight, _stack: ExitStack) -> None:
    flight.vehicle.trajectory.tick = _die  # type: ignore[method-assign]


def _kill_health(_flight: Flight, stack: ExitStack) -> None:
    stack.enter_context(mock.patch("daemon.loops.health_task.notify", _die))


def _kill_control(_flight: Flight, stack: ExitStack) -> None:
    stack.enter_context(mock.patch("daemon.pipeline.step", _die))


def _kill_link(flight: Flight, _stack: ExitStack) -> None:
    flight.autopilot.session.poll = _die  # type: ignore[method-assign]


def _stall_trajectory(flight: Flight, _stack: ExitStack) -> None:
    flight.vehicle.trajectory.tick = lambda _now_s: None  # type: ignore[method-assign]
    flight.vehicle.trajectory.grid._alarm.set(1e9, lambda: None)


def _machine() -> list[Case]:
    return [
        Case(name="wall clock steps an hour ahead", do=_wall_clock(HOUR_S)),
        Case(name="wall clock steps an hour back", do=_wall_clock(-HOUR_S)),
    ]


def _wall_clock(step_s: float) -> Deed:
    def do(_flight: Flight, stack: ExitStack) -> None:
        seconds, nanoseconds = time.time, time.time_ns
        stack.enter_context(mock.patch("time.time", lambda: seconds() + step_s))
        stack.enter_context(mock.patch("time.time_ns", lambda: nanoseconds() + int(step_s * 1e9)))

    return do


def _refusals() -> list[Case]:
    offboard: dict[str, Any] = {
        "start": Start.IN_HOLD,
        "faults": (ModesRefused(modes=("offboard",)),),
        "outcome": "aborted",
        "left": "engage_refused",
        "state": State.READY,
        "mode": HOLD,
        "asked": (FlightMode.OFFBOARD, HOLD),
        "silent_s": 3.0,
        "hold_s": 0.1,
    }
    ground: dict[str, Any] = {
        "start": Start.ON_GROUND,
        "do": _takeoff_is_refused,
        "outcome": "",
        "state": State.STANDBY,
        "mode": HOLD,
        "silent_s": 0.0,
        "hold_s": 0.1,
        "inside_m": 0.5,
        "words": "the request fails with the autopilot's reason, nothing is sent",
    }
    return [
        Case(name="offboard refused", **offboard),
        Case(name="arming refused", faults=(ArmingRefused(),), **ground),
        Case(name="take-off refused", faults=(ModesRefused(modes=("takeoff",)),), **ground),
    ]


async def _takeoff_is_refused(flight: Flight, _stack: ExitStack) -> None:
    with pytest.raises((CommandRefusedError, NotPossibleError)):
        await flight.vehicle.commander.takeoff(5.0)


def _fence() -> list[Case]:
    fence = {"safety": {"fence": {"radius_m": FENCE_M}}}
    tight = {"safety": {"fence": {"radius_m": FENCE_M, "hard_margin_m": 1.0}}}
    inside = (18.0, 0.0, -5.0)
    edge: dict[str, Any] = {
        "goal_ned_m": (19.7, 0.0, -5.0),
        "stays_s": 60.0,
        "strikes_at_m": 19.5,
        "outcome": "aborted",
    }
    return [
        Case(
            name="goal beyond the fence, while flying",
            do=_refused({"position": [25.0, 0.0, -5.0]}, "outside the fence"),
            goal_ned_m=inside,
            inside_m=FENCE_M,
            config=fence,
            words="refused; the goal before succeeds",
        ),
        Case(
            name="goal inside the fence, beyond it from a moving start",
            do=_refused({"position": [14.0, 2.0, -5.0]}, "on the way", acceleration_m_s2=0.5),
            goal_ned_m=inside,
            strikes_at_m=12.0,
            inside_m=FENCE_M,
            config=fence,
            words="refused; the goal before succeeds",
        ),
        Case(
            name="gust of 15 m/s across the fence",
            faults=(WindGust(north_m_s=15.0, duration_s=2.0),),
            tilt_deg=45.0,
            watch_s=10.0,
            config=fence,
            words="the goal ends `aborted`, the vehicle comes back inside and holds",
            **edge,
        ),
        Case(
            name="wind of 30 m/s across the hard fence",
            faults=(SteadyWind(north_m_s=30.0),),
            left="geofence",
            state=State.LANDING,
            mode=FlightMode.RETURN,
            asked=(HOLD, FlightMode.RETURN),
            silent_s=3.0,
            hold_s=3.0,
            tilt_deg=50.0,
            config=tight,
            **edge,
        ),
    ]


def _refused(waypoint: dict[str, Any], words: str, **limits: float) -> Deed:
    async def do(flight: Flight, _stack: ExitStack) -> None:
        with pytest.raises(ProtocolError, match=words):
            await flight.submit(waypoint=waypoint, **({"limits": limits} if limits else {}))

    return do


CASES = [*_tasks(), *_machine(), *_refusals(), *_fence()]
