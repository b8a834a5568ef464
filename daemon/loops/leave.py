"""Another mode of the autopilot's own, in the air: Hold, landing, Return; also how the vehicle is given back."""

import contextlib

from daemon.autopilot.port import CommandTimeoutError
from daemon.loops.asking import Asking
from daemon.loops.engageable import NOT_HEARD
from daemon.loops.turns import NotPossibleError
from daemon.messages import FlightMode, LandedState, RequestKind
from daemon.safety.supervisor import State


async def hold(asking: Asking) -> None:
    """The autopilot's Hold, from any airborne mode except a pilot's; also how the vehicle is released."""
    turn = await _begin(asking, "hold")
    asking.post(RequestKind.HOLD)
    await asking.until_mode(turn, FlightMode.HOLD)
    await asking.until(turn, lambda: _holds(asking), asking.timeouts.mode_s, "in Hold")


def _holds(asking: Asking) -> bool:
    """In Hold, and the landed state, which comes in a message of its own, no longer that of the mode before."""
    passing = asking.status.landed in (LandedState.TAKEOFF, LandedState.LANDING)
    return asking.read and asking.state is State.READY and not passing


async def land(asking: Asking) -> None:
    """Land here; done when disarmed."""
    await _come_down(asking, RequestKind.LAND, FlightMode.LAND, asking.timeouts.land_s)


async def return_home(asking: Asking) -> None:
    """The autopilot's Return; done when disarmed."""
    await _come_down(asking, RequestKind.RETURN, FlightMode.RETURN, asking.timeouts.return_s)


async def _come_down(asking: Asking, kind: RequestKind, mode: FlightMode, limit_s: float) -> None:
    turn = await _begin(asking, kind.value)
    record = asking.record.value
    height_m = 0.0
    if record is not None and record.estimate.newest is not None:
        height_m = max(0.0, -record.estimate.newest.position_ned_m[2])
    asking.post(kind)
    await asking.until_mode(turn, mode)
    await asking.until(turn, lambda: asking.state is State.LANDING, asking.timeouts.mode_s, kind.value + "ing")
    limit_s += height_m / asking.timeouts.descend_m_s
    await asking.until(
        turn,
        lambda: not asking.status.armed or asking.state is not State.LANDING,
        limit_s,
        "landed and disarmed",
    )
    if asking.status.armed:
        raise NotPossibleError(f"{kind.value} ended in state {asking.state.value}: {asking.reason}")
    await asking.until(turn, lambda: asking.state is State.STANDBY, 1.0, "standby")


async def _begin(asking: Asking, what: str) -> int:
    """Begin a request for another mode; a release that is under way is let end first, it takes no second wish.

    A vehicle that is not ours is asked for nothing until it is known who has it now: it may be a pilot.
    """
    with contextlib.suppress(CommandTimeoutError):
        await asking.wait_for(lambda: asking.knows_who_flies, asking.timeouts.mode_s, "heard")
    if not asking.knows_who_flies:
        raise NotPossibleError(f"cannot {what}: {NOT_HEARD}")
    asking.require_flyable(what)
    asking.releases += 1
    turn = asking.turns.begin()
    await asking.until(turn, lambda: asking.state is not State.RELEASING, asking.timeouts.mode_s, "released")
    asking.require_flyable(what)
    return turn
