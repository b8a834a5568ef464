"""What the demo flies, and what it makes of it: the goals, their table, and whether each ended as it should."""

import asyncio
from collections.abc import Callable
from dataclasses import asdict, dataclass

from daemon.goals.client import FlightClient
from daemon.goals.client_errors import RequestError
from daemon.goals.goal import Feedback, Goal, Result
from daemon.recording.analysis import GoalSummary

POSITION_M, HEADING_DEG = 0.3, 5.0  # what counts as there
TAKEOFF_M = 5.0
CONNECT_S, TAKEOFF_S, GOAL_S, LAND_S = 30.0, 40.0, 40.0, 60.0
RETRY_S = 0.5


@dataclass(frozen=True, slots=True)
class Leg:
    """One goal: position NED, heading (None: as it comes), and the share of the way at which the next one preempts."""

    name: str
    north: float
    east: float
    down: float
    yaw_deg: float | None = None
    preempt_at: float | None = None

    @property
    def expected(self) -> str:
        """How this goal should end."""
        return "succeeded" if self.preempt_at is None else "preempted"


LEGS = (
    Leg("10 m north, left on the way", 10.0, 0.0, -5.0, preempt_at=0.4),
    Leg("6 m north, 8 m east, 1 m up", 6.0, 8.0, -6.0),
    Leg("back, heading east", 0.0, 2.0, -4.0, yaw_deg=90.0),
)


@dataclass(frozen=True, slots=True)
class Row:
    """A goal in the demo's table; errors at its end and largest errors against the reference."""

    goal: str
    outcome: str
    expected: str
    duration_s: float | None
    final_error_m: float | None
    final_error_deg: float | None
    largest_error_m: float | None
    largest_tilt_deg: float | None

    @property
    def good(self) -> bool:
        """It ended as it should, and where it should."""
        if self.outcome != self.expected or self.expected == "preempted":
            return self.outcome == self.expected
        return (
            self.final_error_m is not None
            and self.final_error_m <= POSITION_M
            and self.final_error_deg is not None
            and self.final_error_deg <= HEADING_DEG
        )

    def as_dict(self) -> dict[str, object]:
        """For JSON."""
        return {**asdict(self), "good": self.good}


Tell = Callable[[str, bool], None]


async def fly(client: FlightClient, tell: Tell) -> list[Result]:
    """Take off, fly the legs, land. ``tell(text, done)`` hears of each step. Raises ``FlightError``."""
    tell("waiting for the autopilot", False)
    await _connected(client)
    tell("autopilot connected", True)
    tell(f"taking off to {TAKEOFF_M:g} m", False)
    await _take_off(client)
    tell("in the air", True)
    flown: list[tuple[Leg, Goal]] = []
    for leg in LEGS:
        goal = await client.goto(leg.north, leg.east, leg.down, yaw_deg=leg.yaw_deg)
        flown.append((leg, goal))
        async with asyncio.timeout(GOAL_S):
            await _along(leg, goal, tell)
    results = []
    async with asyncio.timeout(GOAL_S):
        for _, goal in flown:
            results.append(await goal)
    tell("landing", False)
    async with asyncio.timeout(LAND_S):
        await client.land()
    tell("landed", True)
    return results


def table(results: list[Result], summaries: list[GoalSummary]) -> list[Row]:
    """One row a leg, with what the record knows of it."""
    by_id = {summary.goal_id: summary for summary in summaries}
    rows = []
    for leg, result in zip(LEGS, results, strict=True):
        known = by_id.get(result.goal_id)
        rows.append(
            Row(
                goal=leg.name,
                outcome=result.outcome,
                expected=leg.expected,
                duration_s=result.duration_s,
                final_error_m=result.error_m,
                final_error_deg=result.error_deg,
                largest_error_m=known.largest_error_m if known else None,
                largest_tilt_deg=known.largest_tilt_deg if known else None,
            )
        )
    return rows


async def _connected(client: FlightClient) -> None:
    async with asyncio.timeout(CONNECT_S):
        async for health in client.telemetry("health", rate_hz=5.0):
            if health.data["autopilot"]["connected"]:
                return


async def _take_off(client: FlightClient) -> None:
    """An autopilot that has just started refuses for want of a position: ask again until ``TAKEOFF_S``."""
    loop = asyncio.get_running_loop()
    until_s = loop.time() + TAKEOFF_S
    while True:
        try:
            await client.takeoff(TAKEOFF_M)
        except RequestError:
            if loop.time() > until_s:
                raise
        else:
            return
        await asyncio.sleep(RETRY_S)


async def _along(leg: Leg, goal: Goal, tell: Tell) -> None:
    """Follow a goal until it ends, or until it is time for the next one."""
    async for feedback in goal:
        tell(f"{leg.name}: {_progress(feedback)}", False)
        if leg.preempt_at is not None and feedback.progress >= leg.preempt_at:
            tell(f"{leg.name}: preempted at {feedback.progress:.0%}", True)
            return
    result = await goal
    error = "" if result.error_m is None else f", {result.error_m:.2f} m off"
    tell(f"{leg.name}: {result.outcome}{error}", True)


def _progress(feedback: Feedback) -> str:
    distance = "" if feedback.distance_m is None else f"{feedback.distance_m:.1f} m to go"
    return distance if feedback.eta_s is None else f"{distance}, {feedback.eta_s:.0f} s"
