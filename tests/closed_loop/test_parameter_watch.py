"""The autopilot's parameters: the dangerous are told, its hover thrust is taken, the unanswered are asked for again."""

from dataclasses import replace
from typing import Any

import pytest
import structlog
from support.flight import Flight, fly

from daemon.loops import parameter_watch
from daemon.reports import Reports
from daemon.safety.supervisor import State
from daemon.sim.airframe_files import load as load_airframe

NAMES = {"MPC_THR_HOVER", "COM_RC_OVERRIDE", "COM_OF_LOSS_T", "COM_OBL_RC_ACT", "COM_LOW_BAT_ACT"}
SOUND = {"COM_RC_OVERRIDE": 3, "COM_OF_LOSS_T": 1.0, "COM_OBL_RC_ACT": 5}


async def standing_by(flight: Flight) -> None:
    await flight.until(lambda: flight.state is State.STANDBY and flight.now_s > 3.0)


async def later(flight: Flight, seconds: float) -> None:
    since_s = flight.now_s
    await flight.until(lambda: flight.now_s - since_s >= seconds)


def warnings(flight: Flight) -> dict[str, str]:
    """What status.get tells of them."""
    return {reason["code"]: reason["text"] for reason in Reports(flight.vehicle).status()["reasons"][1:]}


class Requests:
    """The names that are asked for from now on; ``lost``: they do not reach the autopilot."""

    def __init__(self, flight: Flight, *, lost: bool = False) -> None:
        self.names: list[str] = []
        self.lost = lost
        self._receive = flight.px4.receive
        flight.px4.receive = self._take  # type: ignore[method-assign]

    def _take(self, name: str, fields: dict[str, Any], **sender: int) -> None:
        if name == "PARAM_REQUEST_READ":
            self.names.append(fields["param_id"])
        if name != "PARAM_REQUEST_READ" or not self.lost:
            self._receive(name, fields, **sender)


def test_dangerous_parameters_are_told_with_what_to_set() -> None:
    async def scenario(flight: Flight) -> None:
        await standing_by(flight)
        assert set(warnings(flight)) == {"COM_RC_OVERRIDE", "COM_OF_LOSS_T"}
        assert "set bit 1 (value 3)" in warnings(flight)["COM_RC_OVERRIDE"]

    fly(scenario, parameters={"COM_RC_OVERRIDE": 1, "COM_OF_LOSS_T": 5.0, "COM_OBL_RC_ACT": 5})


@pytest.mark.parametrize(("battery_min_pct", "told"), [(0.0, True), (20.0, False)])
def test_an_empty_battery_that_nobody_acts_on_is_told(battery_min_pct: float, told: bool) -> None:
    async def scenario(flight: Flight) -> None:
        await standing_by(flight)
        assert ("COM_LOW_BAT_ACT" in warnings(flight)) is told

    config = {"safety": {"battery_min_pct": battery_min_pct}}
    fly(scenario, parameters={**SOUND, "COM_LOW_BAT_ACT": 0}, config=config)


@pytest.mark.parametrize("loss_s", [0.5, 1.0])
def test_sound_parameters_are_not_told(loss_s: float) -> None:
    async def scenario(flight: Flight) -> None:
        await standing_by(flight)
        assert warnings(flight) == {}

    fly(scenario, parameters={**SOUND, "COM_OF_LOSS_T": loss_s})


def test_an_autopilot_that_acts_before_the_daemon_does_is_told() -> None:
    async def scenario(flight: Flight) -> None:
        await standing_by(flight)
        assert "set 0.5 to 1.0 s" in warnings(flight)["COM_OF_LOSS_T"]

    fly(scenario, parameters={**SOUND, "COM_OF_LOSS_T": 0.2})


@pytest.mark.parametrize(("configured", "flown", "said"), [(None, 0.45, True), (0.6, 0.6, False)])
def test_the_hover_thrust_of_the_autopilot_is_taken_and_told_where_none_is_configured(
    configured: float | None, flown: float, said: bool
) -> None:
    async def scenario(flight: Flight) -> None:
        await standing_by(flight)
        assert flight.vehicle.parameters.value.control.hover_thrust == pytest.approx(flown)

    with structlog.testing.capture_logs() as lines:
        fly(scenario, parameters={"MPC_THR_HOVER": 0.45}, config={"control": {"hover_thrust": configured}})
    assert ("hover_thrust_from_autopilot" in [line["event"] for line in lines]) is said


def test_what_does_not_answer_is_told_and_asked_for_again_until_it_does() -> None:
    async def scenario(flight: Flight) -> None:
        requests = Requests(flight, lost=True)
        await standing_by(flight)
        await later(flight, 10.0)
        told = warnings(flight)
        assert set(told) == NAMES
        assert "has not answered: the hover thrust starts at 0.5" in told["MPC_THR_HOVER"]
        requests.names.clear()
        await later(flight, 60.0)
        assert 4 * len(NAMES) <= len(requests.names) < 60 * 3
        requests.lost = False
        await later(flight, 20.0)
        assert warnings(flight) == {}
        assert flight.vehicle.parameters.value.control.hover_thrust == pytest.approx(0.62)
        requests.names.clear()
        await later(flight, 30.0)
        assert requests.names == []

    with structlog.testing.capture_logs() as lines:
        fly(scenario, parameters={**SOUND, "MPC_THR_HOVER": 0.62})
    assert sorted(line["name"] for line in lines if line["event"] == "parameter_not_read") == sorted(NAMES)


def test_what_the_autopilot_does_not_know_is_told_and_not_asked_for_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parameter_watch, "HOVER_PARAMETER", "NO_SUCH_PARAM")

    async def scenario(flight: Flight) -> None:
        requests = Requests(flight)
        await standing_by(flight)
        await later(flight, 30.0)
        told = warnings(flight)
        assert set(told) == {"NO_SUCH_PARAM"}
        assert "is not known to the autopilot: the hover thrust starts at 0.5" in told["NO_SUCH_PARAM"]
        assert requests.names.count("NO_SUCH_PARAM") == 1

    fly(scenario, parameters=SOUND)


@pytest.mark.parametrize(("configured", "told"), [(None, True), (0.6, False)])
def test_a_hover_thrust_that_cannot_be_is_not_flown_and_told_where_none_is_configured(
    configured: float | None, told: bool
) -> None:
    async def scenario(flight: Flight) -> None:
        await standing_by(flight)
        assert ("MPC_THR_HOVER" in warnings(flight)) is told
        assert flight.vehicle.parameters.value.control.hover_thrust == pytest.approx(configured or 0.5)

    fly(scenario, parameters={**SOUND, "MPC_THR_HOVER": 0.95}, config={"control": {"hover_thrust": configured}})


def test_a_hover_thrust_that_was_answered_late_carries_the_vehicle_when_it_engages(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    weak = replace(load_airframe("sih"), rotor_max_thrust_n=2.9)
    monkeypatch.setattr("support.flight.load_airframe", lambda _: weak)

    async def scenario(flight: Flight) -> None:
        requests = Requests(flight, lost=True)
        await flight.airborne(engage=False)
        requests.lost = False
        await later(flight, 20.0)
        height_m = -flight.position[2]
        await flight.vehicle.commander.engage()
        since = len(flight.truths)
        await later(flight, 4.0)
        assert height_m - min(-down for _, _, down in flight.truths[since:]) < 0.1

    fly(scenario, parameters={**SOUND, "MPC_THR_HOVER": 0.845})


def test_a_hover_thrust_that_is_answered_in_flight_does_not_bump() -> None:
    async def scenario(flight: Flight) -> None:
        requests = Requests(flight, lost=True)
        await flight.airborne()
        await later(flight, 5.0)
        height_m = -flight.position[2]
        requests.lost = False
        since = len(flight.truths)
        await later(flight, 20.0)
        assert flight.vehicle.parameters.value.control.hover_thrust == pytest.approx(0.62)
        assert max(abs(-down - height_m) for _, _, down in flight.truths[since:]) < 0.05

    fly(scenario, parameters={**SOUND, "MPC_THR_HOVER": 0.62})


def test_a_reboot_that_no_silence_shows_is_followed_by_the_questions() -> None:
    async def scenario(flight: Flight) -> None:
        await standing_by(flight)
        requests = Requests(flight)
        status = flight.autopilot.status
        status.set(replace(status.value, boot_count=status.value.boot_count + 1))
        await later(flight, 2.0)
        assert set(requests.names) == NAMES

    fly(scenario, parameters=SOUND)
