"""What the autopilot does not do is told by the name of the request and in words that help, each of them once."""

from typing import Any

import pytest
from support.flight import CALLER, Flight, fly

from daemon.goals.errors import ErrorCode, ProtocolError
from daemon.goals.methods import NoParams
from daemon.messages import FlightMode
from daemon.safety.supervisor import State
from daemon.sim.faults import ModesRefused, NoAcks

ARM = 400  # MAV_CMD_COMPONENT_ARM_DISARM
DID_NOT_ENGAGE = "the autopilot did not go to offboard within 2 s (temporarily rejected"


async def _on_ground(flight: Flight, mode: FlightMode = FlightMode.HOLD) -> None:
    await flight.until(lambda: flight.state is State.STANDBY and flight.records[-1].estimate.newest is not None)
    flight.autopilot.request_mode(mode)
    await flight.until(lambda: flight.autopilot.status.value.mode is mode)


def test_a_goal_whose_engage_is_refused_ends_with_a_plain_reason_and_an_event_in_words() -> None:
    async def scenario(flight: Flight) -> None:
        events: list[tuple[str, str, str | None]] = []
        flight.hub.event = lambda code, text, goal_id=None, *_: events.append((code, text, goal_id))  # type: ignore[method-assign]
        await flight.airborne(engage=False)
        flight.px4.inject(ModesRefused(modes=("offboard",)))
        goal_id = await flight.goto(5.0, 0.0, -5.0)
        entry = await flight.result(goal_id)
        assert (entry.outcome, entry.reason) == ("aborted", "engage_refused")
        ((_, text, of),) = [event for event in events if event[0] == "engage_refused"]
        assert DID_NOT_ENGAGE in text and of == goal_id

    fly(scenario)


def test_a_refused_engage_says_what_the_autopilot_did_not_do() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne(engage=False)
        flight.px4.inject(ModesRefused(modes=("offboard",)))
        with pytest.raises(ProtocolError) as error:
            await flight.service.vehicle_engage(NoParams(), CALLER)
        assert error.value.code is ErrorCode.AUTOPILOT_REFUSED
        assert DID_NOT_ENGAGE in error.value.reason

    fly(scenario)


def test_a_command_that_shows_needs_no_acknowledgement() -> None:
    async def scenario(flight: Flight) -> None:
        await _on_ground(flight)
        flight.px4.inject(NoAcks())
        await flight.service.vehicle_arm(NoParams(), CALLER)
        assert flight.px4.armed

    fly(scenario)


def test_a_command_without_acknowledgement_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    async def scenario(flight: Flight) -> None:
        await _on_ground(flight)
        receive = flight.px4.receive

        def without_commands(name: str, fields: dict[str, Any], **sender: int) -> None:
            if fields.get("command") != ARM:
                receive(name, fields, **sender)

        monkeypatch.setattr(flight.px4, "receive", without_commands)
        with pytest.raises(ProtocolError) as error:
            await flight.service.vehicle_arm(NoParams(), CALLER)
        assert error.value.code is ErrorCode.TIMED_OUT
        assert error.value.reason == "arm: command 400 was not acknowledged"

    fly(scenario)


@pytest.mark.parametrize("mode", [FlightMode.OFFBOARD, FlightMode.LAND])
def test_arming_in_a_mode_that_does_not_arm_says_what_to_do_instead(mode: FlightMode) -> None:
    async def scenario(flight: Flight) -> None:
        await _on_ground(flight, mode)
        with pytest.raises(ProtocolError) as error:
            await flight.service.vehicle_arm(NoParams(), CALLER)
        assert error.value.code is ErrorCode.AUTOPILOT_REFUSED
        assert error.value.reason.startswith("arm: ")
        hint = f"; the mode is still {mode.value}: vehicle.takeoff goes to Hold first, vehicle.arm does not"
        assert error.value.reason.endswith(hint), error.value.reason

    fly(scenario)
