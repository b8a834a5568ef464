"""The fault matrix as data: each a fault and the response to it."""

from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

from daemon.autopilot.px4 import Fields, command_long
from daemon.messages import FlightMode
from daemon.safety.supervisor import State
from daemon.sim.faults import (
    BatteryLow,
    ClockStep,
    EkfReset,
    FrozenTelemetry,
    GpsLoss,
    KillSwitch,
    Link,
    ModesRefused,
    MotorEfficiency,
    NanTelemetry,
    NoAcks,
    Payload,
    PilotTakesOver,
    Reboot,
    SpoiltTelemetry,
    SteadyWind,
    StoppedTelemetry,
    WindGust,
)
from support.fault_cases_daemon import CASES as DAEMON_CASES
from support.fault_matrix import Case, Start
from support.flight import Flight

HOLD = FlightMode.HOLD


@dataclass(frozen=True, slots=True, kw_only=True)
class BackwardsTelemetry(SpoiltTelemetry):
    """The stamps of the messages count down."""

    def spoil(self, fields: Fields, first: Fields) -> Fields | None:
        """As old as the message is new."""
        return fields | {"time_usec": 2 * first["time_usec"] - fields["time_usec"]}


def _handed_over(left: str, within_s: float, **more: Any) -> dict[str, Any]:
    """The response of a vehicle that is given to the autopilot's Hold."""
    usual = {"state": State.READY, "mode": HOLD, "asked": (HOLD,), "outcome": "aborted"}
    return usual | {"left": left, "silent_s": within_s, "hold_s": within_s} | more


def _taken(left: str, state: State, mode: FlightMode, within_s: float, **more: Any) -> dict[str, Any]:
    """The response to somebody else's taking the vehicle: silence, and nothing is asked for."""
    return {"left": left, "state": state, "mode": mode, "silent_s": within_s, "outcome": "aborted"} | more


def _odometry() -> list[Case]:
    lost = _handed_over("estimate_lost", 0.8)
    return [
        Case(name="odometry stops for 0.05 s", faults=(StoppedTelemetry(duration_s=0.05),)),
        Case(name="odometry stops for 0.2 s", faults=(StoppedTelemetry(duration_s=0.2),)),
        Case(name="odometry stops for 1 s", faults=(StoppedTelemetry(duration_s=1.0),), **lost),
        Case(name="odometry stops for 10 s", faults=(StoppedTelemetry(duration_s=10.0),), **lost),
        Case(name="odometry is NaN for 0.1 s", faults=(NanTelemetry(duration_s=0.1),)),
        Case(name="odometry is NaN", faults=(NanTelemetry(),), **lost),
        Case(name="odometry frozen, stamps advance", faults=(FrozenTelemetry(),), **lost),
        Case(name="odometry frozen, stamps too", faults=(FrozenTelemetry(stamps_advance=False),), **lost),
        Case(name="odometry counts backwards for 0.1 s", faults=(BackwardsTelemetry(duration_s=0.1),)),
        Case(name="odometry counts backwards", faults=(BackwardsTelemetry(),), **lost),
        Case(name="stamps jump 0.3 s back", faults=(ClockStep(step_s=-0.3),)),
        Case(name="stamps jump 5 s back", faults=(ClockStep(step_s=-5.0),)),
        Case(name="stamps jump 1 s ahead", faults=(ClockStep(step_s=1.0),)),
        Case(name="stamps jump an hour ahead", faults=(ClockStep(step_s=3600.0),)),
    ]


def _estimate() -> list[Case]:
    # The autopilot, without a position, leaves Hold for Land by itself.
    gps = _handed_over("estimate_poor", 6.0, state=State.FAULT, mode=FlightMode.LAND)
    return [
        *_resets(", mid-goal"),
        *_resets(", in a hover", start=Start.HOVERING, goal_ned_m=(0.0, 0.0, -5.0), stays_s=6.0, watch_s=10.0),
        Case(name="GPS lost for 1 s", faults=(GpsLoss(duration_s=1.0),)),
        Case(name="GPS lost for 20 s", faults=(GpsLoss(duration_s=20.0),), watch_s=12.0, **gps),
    ]


def _resets(when: str, **more: Any) -> list[Case]:
    kinds = (
        ("the position, 3 m north", EkfReset(kind="position_ne", size_m=3.0)),
        ("the height, 1 m", EkfReset(kind="position_d", size_m=1.0)),
        ("the velocity, 0.5 m/s north", EkfReset(kind="velocity_ne")),
        ("the climb, 0.5 m/s", EkfReset(kind="velocity_d")),
        ("the heading, 20 deg", EkfReset(kind="heading")),
    )
    return [Case(name=f"EKF reset of {what}{when}", faults=(fault,), **more) for what, fault in kinds]


def _link() -> list[Case]:
    slow = {"loops": {"command_latency_s": 0.07}}
    slowly = _handed_over("link_slow", 1.2, tilt_deg=50.0)
    failsafe = FlightMode.RETURN
    return [
        Case(name="link loses 10 %", faults=(Link(loss=0.1),)),
        Case(name="link loses 30 %", faults=(Link(loss=0.3),)),
        Case(name="setpoints late by 30 ms more", faults=(Link(delay_s=0.03, direction="up"),), tilt_deg=40.0),
        Case(name="setpoints late by 50 ms, configured", faults=(Link(delay_s=0.05, direction="up"),), config=slow),
        Case(
            name="setpoints late by 50 ms, configured by nobody",
            faults=(Link(delay_s=0.05, direction="up"),),
            tilt_deg=40.0,
            watch_s=30.0,
        ),
        Case(name="setpoints late by 0.3 s", faults=(Link(delay_s=0.3, direction="up"),), **slowly),
        Case(name="telemetry late by 0.3 s", faults=(Link(delay_s=0.3, direction="down"),), **slowly),
        Case(name="link late by 0.15 s each way", faults=(Link(delay_s=0.15),), **slowly),
        Case(name="link jitters by 30 ms", faults=(Link(jitter_s=0.03),), tilt_deg=40.0),
        Case(name="link reorders 10 %", faults=(Link(reordering=0.1),)),
        Case(name="link silent for 0.3 s", faults=(Link(silent=True, duration_s=0.3),)),
        Case(
            name="link silent for 0.5 s",
            faults=(Link(silent=True, duration_s=0.5),),
            **_handed_over("estimate_lost", 0.8),
        ),
        Case(
            name="link silent for 0.7 s",
            faults=(Link(silent=True, duration_s=0.7),),
            **_handed_over("estimate_lost", 0.8),
        ),
        *(
            Case(
                name=f"link silent for {duration_s:g} s, as the vehicle begins to move",
                faults=(Link(silent=True, duration_s=duration_s),),
                strikes_at_m=0.1,
                tilt_deg=70.0,  # the autopilot keeps the last rate until the link is back
                **_handed_over("estimate_lost", duration_s + 0.1),
            )
            for duration_s in (0.7, 0.9)
        ),
        Case(
            name="link silent for 0.7 s, in a turn",
            faults=(Link(silent=True, duration_s=0.7),),
            start=Start.CIRCLING,
            tilt_deg=70.0,
            **_handed_over("estimate_lost", 0.8),
        ),
        Case(
            name="link silent for 5 s",
            faults=(Link(silent=True, duration_s=5.0),),
            tilt_deg=70.0,
            **_taken("estimate_lost", State.FAULT, failsafe, 1.4, asked=(HOLD,)),
        ),
        Case(
            name="nothing comes from the autopilot",
            faults=(Link(silent=True, direction="down"),),
            **_handed_over("estimate_lost", 1.4, state=State.DISCONNECTED),
        ),
        Case(
            name="setpoints lost on the way",
            faults=(Link(silent=True, direction="up"),),
            tilt_deg=60.0,  # the autopilot keeps the last rate until its failsafe
            **_taken("autopilot_failsafe", State.FAULT, failsafe, 1.3),
        ),
        Case(
            name="autopilot reboots",
            faults=(Reboot(),),
            tilt_deg=90.0,  # its motors stand still
            **_taken("estimate_lost", State.STANDBY, FlightMode.LAND, 1.4, asked=(HOLD, FlightMode.LAND), hold_s=0.1),
        ),
    ]


def _pilot() -> list[Case]:
    manual = ("position", "position_slow", "altitude", "altitude_cruise", "stabilized", "acro", "manual")
    modes = (*manual, "hold", "return", "land", "mission")
    switched = [
        Case(
            name=f"pilot switches to {name}",
            faults=(PilotTakesOver(mode=name),),
            **_taken("pilot_override", State.PILOT, FlightMode(name), 0.1, hold_s=0.1 if name == "hold" else None),
        )
        for name in modes
    ]
    offboard = FlightMode.OFFBOARD
    return [
        *switched,
        Case(name="kill switch", faults=(KillSwitch(),), **_taken("terminated", State.STANDBY, offboard, 1.1)),
        Case(name="pilot disarms", do=_disarm, **_taken("disarmed", State.STANDBY, offboard, 0.1)),
    ]


def _refusals() -> list[Case]:
    land = FlightMode.LAND
    refused = _handed_over("estimate_lost", 0.8, hold_s=None, asked=(HOLD, land), state=State.LANDING, mode=land)
    both = _handed_over("estimate_lost", 1.4, hold_s=None, asked=(HOLD, land), state=State.FAULT)
    gone = StoppedTelemetry()
    return [
        Case(name="odometry stops, Hold refused", faults=(ModesRefused(modes=("hold",)), gone), **refused),
        Case(
            name="odometry stops, Hold and Land refused",
            faults=(ModesRefused(modes=("hold", "land")), gone),
            **both | {"mode": FlightMode.RETURN},
        ),
        Case(
            name="odometry stops, nothing is acknowledged",
            faults=(NoAcks(), gone),
            **_handed_over("estimate_lost", 0.8),
        ),
        Case(
            name="odometry stops on a link that loses 30 %",
            faults=(Link(loss=0.3), gone),
            **_handed_over("estimate_lost", 0.9),
        ),
    ]


def _vehicle() -> list[Case]:
    empty = _taken("autopilot_failsafe", State.FAULT, FlightMode.RETURN, 1.5, hold_s=1.5)
    return [
        Case(name="battery critical, autopilot acts", faults=(BatteryLow(fraction=0.06),), **empty),
        Case(name="gust of 10 m/s from the side", faults=(WindGust(east_m_s=10.0, duration_s=3.0),), tilt_deg=40.0),
        Case(name="20 % less thrust of one rotor", faults=(MotorEfficiency(rotor=0, efficiency=0.8),)),
        Case(name="20 % less thrust", faults=tuple(MotorEfficiency(rotor=i, efficiency=0.8) for i in range(4))),
        Case(name="30 % more mass", faults=(Payload(mass_kg=0.3),)),
        Case(name="100 % more mass", faults=(Payload(mass_kg=1.0),), **_handed_over("not_followed", 3.0)),
        Case(
            name="wind of 9 m/s from behind that stays",
            faults=(SteadyWind(north_m_s=9.0),),
            watch_s=18.0,
            **_handed_over("not_followed", 16.0),
        ),
    ]


def _disarm(flight: Flight, _stack: ExitStack) -> None:
    """A ground station disarms in the air, by force."""
    name, fields = command_long(400, 0.0, 21196.0)
    flight.px4.receive(name, fields, sender_system=255, sender_component=190)


CASES = [*_odometry(), *_estimate(), *_link(), *_pilot(), *_refusals(), *_vehicle(), *DAEMON_CASES]
