"""The tracking benchmark on a PX4 that is connected: a simulator on this machine, never a vehicle."""

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable, Iterable

from daemon.autopilot.mavsdk_link import MavsdkLink
from daemon.autopilot.port import LinkError
from daemon.bench.cockpit import Cockpit, Flown
from daemon.bench.manoeuvres import Manoeuvre
from daemon.bench.track import HEIGHT_M, MAVROS, OURS, PX4, Condition, Contestant, Run, configuration, figures
from daemon.loops.grid import live_alarm
from daemon.loops.turns import NotPossibleError
from daemon.messages import Reference, Setpoint, Vec3

AS_IT_IS = Condition(name="px4")
_POSITION_VELOCITY_ACCELERATION_YAW = 0  # type_mask: nothing is ignored
_LOCAL_NED = 1


class PositionTargetLink(MavsdkLink):
    """Sends the reference of now to PX4's own position controller in place of a body-rate setpoint, when told so."""

    target: Callable[[], Reference | None] | None = None

    def send_setpoint(self, setpoint: Setpoint) -> bool:
        """Send SET_POSITION_TARGET_LOCAL_NED, or the setpoint."""
        if self.target is None:
            return super().send_setpoint(setpoint)
        wire, reference = self._wire, self.target()
        if wire is None or reference is None:
            return False
        return wire.send(("SET_POSITION_TARGET_LOCAL_NED", _position_target(reference)))


def _position_target(r: Reference) -> dict[str, float | int]:
    x, y, z = r.position_ned_m
    vx, vy, vz = r.velocity_ned_m_s
    ax, ay, az = r.acceleration_ned_m_s2
    return {
        "time_boot_ms": 0,
        "coordinate_frame": _LOCAL_NED,
        "type_mask": _POSITION_VELOCITY_ACCELERATION_YAW,
        "x": x,
        "y": y,
        "z": z,
        "vx": vx,
        "vy": vy,
        "vz": vz,
        "afx": ax,
        "afy": ay,
        "afz": az,
        "yaw": r.yaw_rad,
        "yaw_rate": r.yaw_rate_rad_s,
    }


async def connected(
    url: str,
    manoeuvres: Iterable[Manoeuvre],
    contestants: Iterable[Contestant] = (OURS, MAVROS, PX4),
    *,
    hover_thrust: float,
    drag_1_s: Vec3,
) -> AsyncIterator[Run]:
    """Take off if need be, fly every manoeuvre with every contestant in turn, land; yields each run's figures."""
    if "127.0.0.1" not in url:
        raise ValueError(f"{url}: this flies laws that protect nothing; only a simulator on 127.0.0.1 is accepted")
    loop = asyncio.get_running_loop()
    manoeuvres, contestants = list(manoeuvres), list(contestants)
    link = PositionTargetLink(url)
    config = configuration(manoeuvres[0], drag_1_s)
    cockpit = Cockpit(link, config, contestants[0].parameters(config, hover_thrust), lambda: live_alarm(loop))
    tasks = asyncio.ensure_future(cockpit.run())
    try:
        await cockpit.airborne(HEIGHT_M)
        for manoeuvre in manoeuvres:
            for contestant in contestants:
                flown = await _flight(cockpit, link, manoeuvre, contestant, hover_thrust, drag_1_s)
                yield figures(manoeuvre, AS_IT_IS, contestant, flown)
        with contextlib.suppress(LinkError, NotPossibleError):
            await cockpit.commander.land()
    finally:
        tasks.cancel()
        await asyncio.gather(tasks, return_exceptions=True)


async def _flight(
    cockpit: Cockpit,
    link: PositionTargetLink,
    manoeuvre: Manoeuvre,
    contestant: Contestant,
    hover_thrust: float,
    drag_1_s: Vec3,
) -> Flown:
    config = configuration(manoeuvre, drag_1_s if contestant.drag_known else (0.0, 0.0, 0.0))
    if contestant.position_targets:
        link.target = _Target(cockpit)
    try:
        await cockpit.settle_in_hold()
        return await cockpit.fly(manoeuvre, contestant.parameters(config, hover_thrust), lambda: None)
    except (LinkError, NotPossibleError) as error:
        return Flown(lost=str(error))
    finally:
        link.target = None


class _Target:
    """The manoeuvre's reference of now; before it begins, where the vehicle was when first asked."""

    def __init__(self, cockpit: Cockpit) -> None:
        self._cockpit = cockpit
        self._start: Reference | None = None

    def __call__(self) -> Reference | None:
        now_s = asyncio.get_running_loop().time()
        if self._cockpit.reference_at is not None:
            return self._cockpit.reference_at(now_s)
        if self._start is None:
            self._start = self._cockpit.here(now_s)
        return self._start
