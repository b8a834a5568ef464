"""What is no multirotor is neither armed, taken off nor engaged, and may be given back at any time."""

import asyncio

import pytest
from support.flight import CALLER, Flight, fly

from daemon.autopilot.port import Command, CommandKind
from daemon.goals.errors import ErrorCode, ProtocolError
from daemon.goals.methods import NoParams, Takeoff
from daemon.messages import FlightMode
from daemon.safety.supervisor import State

WORDS = "flightd flies multirotors, and the autopilot says that this is a"


@pytest.mark.parametrize(("mav_type", "name"), [(1, "fixed-wing"), (10, "rover"), (22, "VTOL")])
def test_a_vehicle_that_is_no_multirotor_stays_disarmed(mav_type: int, name: str) -> None:
    async def scenario(flight: Flight) -> None:
        await flight.until(lambda: flight.state is State.STANDBY and flight.records[-1].estimate.newest is not None)
        for ask in (
            flight.service.vehicle_arm(NoParams(), CALLER),
            flight.service.vehicle_takeoff(Takeoff(altitude_m=5.0), CALLER),
        ):
            with pytest.raises(ProtocolError, match=f"{WORDS} {name}") as error:
                await ask
            assert error.value.code is ErrorCode.WRONG_STATE
        await asyncio.sleep(1.0)
        assert not flight.px4.armed
        assert name in flight.vehicle.health.warnings["airframe"]

    fly(scenario, parameters={"MAV_TYPE": mav_type})


def test_a_vtol_that_somebody_flies_is_not_engaged_but_may_be_landed() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.until(lambda: flight.state is State.STANDBY and flight.records[-1].estimate.newest is not None)
        status = flight.autopilot.status.value
        assert status.global_position is not None
        await flight.autopilot.command(Command(CommandKind.ARM), 1.0)
        up_m = status.global_position.altitude_amsl_m + 10.0
        await flight.autopilot.command(Command(CommandKind.TAKEOFF, up_m), 1.0)
        await flight.until(lambda: flight.autopilot.status.value.mode is FlightMode.HOLD and flight.position[2] < -8.0)
        await flight.service.vehicle_hold(NoParams(), CALLER)
        with pytest.raises(ProtocolError, match=f"cannot engage: {WORDS} VTOL"):
            await flight.service.vehicle_engage(NoParams(), CALLER)
        with pytest.raises(ProtocolError, match=f"cannot engage: {WORDS} VTOL"):
            await flight.goto(5.0, 0.0, -10.0)
        assert flight.sent == []
        await flight.service.vehicle_land(NoParams(), CALLER)
        assert not flight.px4.armed

    fly(scenario, parameters={"MAV_TYPE": 22})
