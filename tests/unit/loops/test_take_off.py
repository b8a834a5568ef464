"""Arming, disarming and taking off: when each is done, and what ends it elsewhere."""

import asyncio
from dataclasses import replace

import pytest
from support.commander_rig import GROUND, Vehicle, answers, play

from daemon.autopilot.port import CommandKind, CommandRefusedError
from daemon.loops.turns import NotPossibleError
from daemon.messages import FlightMode, LandedState, RequestKind
from daemon.safety.supervisor import State


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


@pytest.mark.parametrize("mode", [FlightMode.POSITION, FlightMode.MANUAL, FlightMode.MISSION, FlightMode.LAND])
def test_whoever_changes_the_mode_while_the_vehicle_is_armed_keeps_it(mode: FlightMode) -> None:
    async def scenario(vehicle: Vehicle) -> None:
        def arm() -> None:
            vehicle.later(0.4, State.STANDBY, mode=mode)
            vehicle.later(0.8, State.STANDBY, armed=True)

        answers(vehicle, {CommandKind.ARM: arm})
        with pytest.raises(NotPossibleError, match=f"somebody else changed the mode to {mode.value}"):
            await vehicle.commander.takeoff(5.0)
        assert vehicle.asked == [CommandKind.ARM]

    play(scenario)


def test_a_take_off_that_ends_elsewhere_says_where() -> None:
    async def scenario(vehicle: Vehicle) -> None:
        def taken() -> None:
            vehicle.later(0.2, State.TAKING_OFF)
            vehicle.later(1.0, State.PILOT, "pilot_override")

        answers(vehicle, {CommandKind.TAKEOFF: taken})
        with pytest.raises(CommandRefusedError, match=r"take-off ended in state pilot: somebody else changed the mode"):
            await vehicle.commander.takeoff(5.0)

    play(scenario, replace(GROUND, armed=True))


@pytest.mark.parametrize("waits_for", [RequestKind.HOLD, CommandKind.ARM, CommandKind.TAKEOFF])
def test_a_take_off_goes_no_further_when_the_daemon_stood_still_meanwhile(
    waits_for: CommandKind | RequestKind,
) -> None:
    async def scenario(vehicle: Vehicle) -> None:
        shown = {
            RequestKind.HOLD: lambda: vehicle.set(State.STANDBY, mode=FlightMode.HOLD),
            CommandKind.ARM: lambda: vehicle.set(State.STANDBY, armed=True),
            CommandKind.TAKEOFF: lambda: vehicle.set(State.TAKING_OFF, mode=FlightMode.TAKEOFF),
        }

        def script(asked: CommandKind | RequestKind) -> None:
            if asked is waits_for:
                vehicle.commander.stood_still()
            shown.get(asked, lambda: None)()

        vehicle.script = script
        with pytest.raises(NotPossibleError, match="the daemon stood still"):
            await vehicle.commander.takeoff(7.0)
        await asyncio.sleep(1.0)
        whole = [RequestKind.HOLD, CommandKind.ARM, CommandKind.TAKEOFF]
        assert [asked for asked in vehicle.asked if asked in whole] == whole[: whole.index(waits_for) + 1]
        assert vehicle.withdrawn == 2

    play(scenario, replace(GROUND, mode=FlightMode.LAND))
