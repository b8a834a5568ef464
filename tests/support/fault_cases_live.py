"""The rows of the fault matrix that are about the process, its machine and the link: in real time, over MAVSDK."""

import asyncio
import signal
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path

from daemon.goals.client import FlightClient
from daemon.messages import FlightMode
from daemon.sim.faults import PilotTakesOver
from support.air import engaged
from support.fault_live import LiveCase, Scene
from support.processes import troubled_daemon, until

HOLD, RETURN, OFFBOARD = FlightMode.HOLD, FlightMode.RETURN, FlightMode.OFFBOARD
FLOODER = Path(__file__).parent / "flooder.py"
FLOODERS = 4
LAST_RATE_DEG = 90.0  # tilt: nobody can level the vehicle, and the autopilot keeps the last rate until its failsafe


def _struck_for(seconds: float) -> Callable[[Scene], Awaitable[None]]:
    async def do(scene: Scene) -> None:
        scene.signal(signal.SIGUSR1)
        await scene.air.passes(seconds)

    return do


async def _blocked_then_engaged(scene: Scene) -> None:
    scene.signal(signal.SIGUSR1)
    await scene.air.passes(5.5)
    await scene.look()
    await engaged(scene.flight)
    assert scene.air.px4.mode is OFFBOARD, "who asks for it gets the vehicle again"


async def _stopped_and_continued(scene: Scene) -> None:
    scene.signal(signal.SIGSTOP)
    await scene.air.until(lambda: scene.air.px4.mode is RETURN)
    scene.air.px4.inject(PilotTakesOver(mode="position"))
    await scene.air.passes(1.0)
    scene.signal(signal.SIGCONT)
    await scene.air.passes(3.0)


async def _killed_and_restarted(scene: Scene) -> None:
    await scene.child.stop(signal.SIGKILL)
    await scene.air.until(lambda: scene.air.px4.mode is RETURN)
    await scene.look()
    sent = len(scene.air.sent)
    async with (
        troubled_daemon(scene.config.parent, scene.air.connection) as child,
        FlightClient(child.socket) as flight,
    ):
        status = await until(flight, lambda status: status["state"] not in ("disconnected", "standby"))
        assert status["state"] in ("pilot", "fault")
        await scene.air.passes(2.0)
        assert (len(scene.air.sent), scene.air.px4.mode) == (sent, RETURN), "it touches nothing"
        await flight.hold()
        await engaged(flight)
        assert scene.air.px4.mode is OFFBOARD
        await flight.hold()


async def _terminated(scene: Scene) -> None:
    await scene.child.stop(signal.SIGTERM)
    await scene.air.passes(1.0)


async def _terminated_by_two(scene: Scene) -> None:
    """As when a wrapper forwards what the terminal has sent already."""
    scene.signal(signal.SIGINT)
    await _terminated(scene)


async def _ended(scene: Scene) -> None:
    scene.signal(signal.SIGUSR1)
    await scene.child.process.wait()
    await scene.air.passes(1.5)


async def _record_fails(scene: Scene) -> None:
    scene.signal(signal.SIGUSR1)
    await scene.goal_ends()


async def _flooded(scene: Scene) -> None:
    flooders = [
        await asyncio.create_subprocess_exec(sys.executable, str(FLOODER), str(scene.child.socket))
        for _ in range(FLOODERS)
    ]
    try:
        await scene.goal_ends()
    finally:
        for flooder in flooders:
            flooder.kill()
            await flooder.wait()


async def _configuration_replaced(scene: Scene) -> None:
    scene.config.write_text("guidance: {limits: {speed_m_s: 20.0}}\n")
    await scene.air.passes(1.0)
    scene.config.write_text("no: such\n")
    await scene.goal_ends()
    assert (await scene.flight.get_config("guidance.limits.speed_m_s"))["value"] == 5.0


async def _nobody_reads_the_log(scene: Scene) -> None:
    assert scene.pipe is not None
    scene.pipe.fill()
    for speed_m_s in (5.0, 4.9, 5.0):
        await scene.flight.set_config("guidance.limits.speed_m_s", speed_m_s)
        await scene.air.passes(0.2)
    await scene.goal_ends()


CASES: tuple[LiveCase, ...] = (
    LiveCase(
        name="event loop blocked for 0.3 s",
        words="survived, or handed over to Hold: this is where the dead-man latches",
        do=_struck_for(3.0),
        trouble="loop_blocked",
        block_s=0.3,
        states=("tracking", "fault"),
        modes=(OFFBOARD, HOLD),
        outcomes=("-", "aborted"),
    ),
    LiveCase(
        name="event loop blocked for 5 s",
        words="levelled after 0.1 s, Hold within 0.9 s, while it is blocked; `fault` until engaged",
        do=_blocked_then_engaged,
        trouble="loop_blocked",
        block_s=5.0,
        states=("fault",),
        modes=(HOLD,),
        outcomes=("aborted",),
        silent_s=0.6,
        hold_s=0.9,
        starves=True,
        says=("dead_man_levelled", "dead_man_latched"),
    ),
    LiveCase(
        name="a call holds the interpreter lock for 3 s",
        words="the stream ends, PX4's failsafe acts; silent afterwards",
        do=_struck_for(6.0),
        trouble="interpreter_held",
        block_s=3.0,
        states=("fault", "pilot"),
        modes=(RETURN,),
        outcomes=("aborted",),
        silent_s=0.4,
        tilt_deg=LAST_RATE_DEG,
        starves=True,
    ),
    LiveCase(
        name="SIGSTOP until PX4 returned and a pilot took over, then SIGCONT",
        words="not one setpoint, no command; the pilot keeps it",
        do=_stopped_and_continued,
        states=("fault", "pilot"),
        modes=(FlightMode.POSITION,),
        outcomes=("aborted",),
        silent_s=0.4,
        tilt_deg=LAST_RATE_DEG,
        starves=True,
    ),
    LiveCase(
        name="SIGKILL, restarted",
        words="PX4 returns; the new daemon touches nothing, takes the vehicle on request",
        do=_killed_and_restarted,
        states=("-",),
        modes=(RETURN,),
        outcomes=("-",),
        silent_s=0.4,
        tilt_deg=LAST_RATE_DEG,
        exits=-signal.SIGKILL,
    ),
    LiveCase(
        name="SIGTERM",
        words="Hold within 1.5 s, the goal ends, exit code 0",
        do=_terminated,
        states=("-",),
        modes=(HOLD,),
        outcomes=("aborted",),
        silent_s=1.5,
        hold_s=1.5,
        exits=0,
        says=("stopped",),
    ),
    LiveCase(
        name="SIGINT and SIGTERM at once",
        words="as SIGTERM alone",
        do=_terminated_by_two,
        states=("-",),
        modes=(HOLD,),
        outcomes=("aborted", "canceled"),
        silent_s=1.5,
        hold_s=1.5,
        exits=0,
        says=("stopped",),
    ),
    LiveCase(
        name="link task dies",
        words="Hold within 0.5 s, the goal `aborted`, the daemon ends with code 1",
        do=_ended,
        trouble="link_dies",
        states=("-",),
        modes=(HOLD,),
        outcomes=("aborted",),
        silent_s=0.5,
        hold_s=0.5,
        exits=1,
        says=("task_failed", "stopped"),
    ),
    LiveCase(
        name=f"socket flooded by {FLOODERS} clients",
        words="flies on, the goal succeeds",
        do=_flooded,
    ),
    LiveCase(
        name="disk full while recording",
        words="flies on without a record, says so, tries again",
        do=_record_fails,
        trouble="disk_full",
        says=("record_opened", "record_failed"),
    ),
    LiveCase(
        name="disk becomes read-only while recording",
        words="flies on without a record, says so, tries again",
        do=_record_fails,
        trouble="read_only",
        says=("record_opened", "record_failed"),
    ),
    LiveCase(
        name="configuration file replaced, by a bad one too",
        words="nothing until a restart",
        do=_configuration_replaced,
    ),
    LiveCase(
        name="the log's reader stops reading",
        words="flies on; the log follows when it reads again",
        do=_nobody_reads_the_log,
        pipe=True,
        says=("config_set", "goal_ended", "stopped"),
    ),
)
