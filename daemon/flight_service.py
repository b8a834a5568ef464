"""What a client can ask for, done with the tasks: the daemon's side of the goal protocol."""

import asyncio
from collections.abc import Awaitable, Callable

from daemon import logs, orders, pipeline
from daemon.autopilot.port import CommandRefusedError, CommandTimeoutError, NotConnectedError
from daemon.goals import methods, results
from daemon.goals.errors import ErrorCode, ProtocolError
from daemon.goals.hub import Hub
from daemon.goals.service import Caller, Identity
from daemon.journal import Journal
from daemon.live_settings import LiveSettings
from daemon.loops.commander import Commander
from daemon.loops.goal_book import GoalEntry
from daemon.loops.goal_order import Progress
from daemon.loops.turns import NotPossibleError
from daemon.loops.vehicle import Vehicle
from daemon.messages import FlightMode, LandedState
from daemon.reports import Reports, goal_feedback, goal_record
from daemon.safety.supervisor import FLYING, State

LEFT_BY_A_LANDING = frozenset({FlightMode.OFFBOARD, FlightMode.LAND, FlightMode.RETURN})

log = logs.get("service")


class Service:
    """Implements ``FlightService``: reads the vehicle's parts, and changes them through their mailboxes only."""

    def __init__(self, vehicle: Vehicle, reports: Reports, hub: Hub, journal: Journal) -> None:
        self._vehicle = vehicle
        self._hub = hub
        self._journal = journal
        self._reports = reports
        self._settings = LiveSettings(vehicle)
        self._started_s = asyncio.get_running_loop().time()
        self._engaging: set[asyncio.Task[None]] = set()
        vehicle.trajectory.listeners.append(self)

    # -- what the trajectory task tells

    def goal_progress(self, progress: Progress) -> None:
        """See ``GoalListener``."""
        self._hub.goal_feedback(goal_feedback(progress))

    def goal_ended(self, entry: GoalEntry) -> None:
        """See ``GoalListener``."""
        record = goal_record(entry)
        self._hub.goal_result(record)
        self._journal.goal("ended", entry.goal_id, record)
        log.info("goal_ended", goal_id=entry.goal_id, outcome=entry.outcome, reason=entry.reason, by=entry.by)

    # -- reading

    def identity(self) -> Identity:
        """See ``FlightService``."""
        uptime_s = asyncio.get_running_loop().time() - self._started_s
        return Identity(config_hash=self._vehicle.config.hash(), uptime_s=uptime_s)

    async def status_get(self, params: methods.NoParams, caller: Caller) -> results.Status:
        """See ``FlightService``."""
        return self._reports.status()

    async def goal_get(self, params: methods.GoalGet, caller: Caller) -> results.GoalRecord:
        """See ``FlightService``."""
        return goal_record(self._entry(params.goal_id))

    # -- the vehicle

    async def vehicle_arm(self, params: methods.NoParams, caller: Caller) -> results.VehicleDone:
        """See ``FlightService``."""
        try:
            return await self._done(self._commander.arm)
        except ProtocolError as error:
            mode = self._vehicle.autopilot.status.value.mode
            if error.code is not ErrorCode.AUTOPILOT_REFUSED or mode not in LEFT_BY_A_LANDING:
                raise
            hint = f"the mode is still {mode.value}: vehicle.takeoff goes to Hold first, vehicle.arm does not"
            raise ProtocolError(error.code, f"{error.reason}; {hint}") from None

    async def vehicle_disarm(self, params: methods.NoParams, caller: Caller) -> results.VehicleDone:
        """See ``FlightService``."""
        return await self._done(self._commander.disarm)

    async def vehicle_takeoff(self, params: methods.Takeoff, caller: Caller) -> results.VehicleDone:
        """See ``FlightService``."""
        ceiling_m = self._vehicle.config.safety.fence.ceiling_m
        if params.altitude_m > ceiling_m:
            reason = f"{params.altitude_m:g} m is above the fence's ceiling of {ceiling_m:g} m"
            raise ProtocolError(ErrorCode.REFUSED, reason, "altitude_m")
        return await self._done(lambda: self._commander.takeoff(params.altitude_m))

    async def vehicle_engage(self, params: methods.NoParams, caller: Caller) -> results.VehicleDone:
        """See ``FlightService``."""
        return await self._done(self._commander.engage)

    async def vehicle_hold(self, params: methods.NoParams, caller: Caller) -> results.VehicleDone:
        """See ``FlightService``."""
        return await self._done(self._commander.hold)

    async def vehicle_land(self, params: methods.NoParams, caller: Caller) -> results.VehicleDone:
        """See ``FlightService``."""
        return await self._done(self._commander.land)

    async def vehicle_return(self, params: methods.NoParams, caller: Caller) -> results.VehicleDone:
        """See ``FlightService``."""
        return await self._done(self._commander.return_home)

    # -- goals

    @property
    def releases(self) -> int:
        """See ``FlightService``."""
        return self._commander.releases

    @property
    def standstills(self) -> int:
        """See ``FlightService``."""
        return self._commander.standstills

    async def goal_submit(self, params: methods.GoalSubmit, caller: Caller, goal_id: str) -> results.GoalAccepted:
        """See ``FlightService``."""
        try:
            await self._heard_if_it_engages()
            self._needs_engage()
            releases, standstills = self.releases, self.standstills
            order = await orders.order(goal_id, params, self._place(), caller.connection)
            if self.releases != releases:
                raise ProtocolError(ErrorCode.WRONG_STATE, "the vehicle was released while the goal was planned")
            if self.standstills != standstills:
                raise ProtocolError(ErrorCode.WRONG_STATE, "the daemon stood still while the goal was planned")
            engage = self._needs_engage()
        except ProtocolError as error:
            self._journal.goal("refused", goal_id, {"field": error.field, "reason": error.reason})
            raise
        preempted = self._vehicle.trajectory.submit(order)
        details = params.model_dump(mode="json", exclude_none=True)
        self._journal.goal("submitted", goal_id, {**details, "preempted": preempted})
        log.info("goal", goal_id=goal_id, kind=order.kind, preempted=preempted, pid=caller.pid, uid=caller.uid)
        if engage:
            self._commander.ask_engage()  # at once: a request that comes later is newer than this
            task = asyncio.get_running_loop().create_task(self._engage_for(goal_id))
            self._engaging.add(task)
            task.add_done_callback(self._engaging.discard)
        return {"goal_id": goal_id, "preempted": preempted}

    async def goal_update(self, params: methods.GoalUpdate, caller: Caller) -> results.GoalRef:
        """See ``FlightService``."""
        active = self._vehicle.trajectory.order
        if active is None or active.goal_id != params.goal_id:
            self._entry(params.goal_id)
            raise ProtocolError(ErrorCode.WRONG_STATE, f"goal {params.goal_id} is not active", "goal_id")
        if active.kind != "waypoint":
            raise ProtocolError(ErrorCode.WRONG_STATE, f"a {active.kind} cannot be moved", "goal_id")
        if self._vehicle.trajectory.canceled:
            raise ProtocolError(ErrorCode.WRONG_STATE, f"goal {params.goal_id} was canceled", "goal_id")
        self._vehicle.trajectory.update(orders.moved(active, params.waypoint, self._place()))
        self._journal.goal("updated", params.goal_id, params.model_dump(mode="json", exclude_none=True))
        return {"goal_id": params.goal_id}

    async def goal_cancel(self, params: methods.GoalCancel, caller: Caller) -> results.GoalRef:
        """See ``FlightService``."""
        active = self._vehicle.trajectory.goal_id
        if params.goal_id is not None and params.goal_id != active:
            self._entry(params.goal_id)
            raise ProtocolError(ErrorCode.WRONG_STATE, f"goal {params.goal_id} is not active", "goal_id")
        if active is None:
            raise ProtocolError(ErrorCode.WRONG_STATE, "no goal is active")
        self._vehicle.trajectory.cancel()
        return {"goal_id": active}

    def reference_set(self, params: methods.ReferenceSet, caller: Caller) -> None:
        """See ``FlightService``."""
        active = self._vehicle.trajectory.order
        if active is None or active.goal_id != params.goal_id or active.kind != "stream":
            raise ProtocolError(ErrorCode.WRONG_STATE, f"{params.goal_id} is not an active stream goal", "goal_id")
        if active.connection != caller.connection:
            raise ProtocolError(ErrorCode.NOT_PERMITTED, "another connection submitted this goal", "goal_id")
        now_s = asyncio.get_running_loop().time()
        sample = orders.stream_sample(params, now_s)
        streamed, limits, fence = self._vehicle.trajectory.streamed, active.limits, self._vehicle.fence
        orders.refuse(orders.stream_refusal(sample, streamed, limits, fence, now_s))
        self._vehicle.trajectory.stream(
            sample, lambda plan: orders.refuse(orders.carried_refusal(plan, limits, self._vehicle.fence))
        )

    def estimator_pose(self, params: methods.EstimatorPose, caller: Caller) -> None:
        """See ``FlightService``."""
        if self._vehicle.config.estimator.external_pose == "off":
            raise ProtocolError(ErrorCode.WRONG_STATE, "the estimator is not configured to take poses from outside")
        now_s = asyncio.get_running_loop().time()
        pose = orders.external_pose(params, now_s)
        orders.refuse(orders.pose_refusal(pose, now_s))
        self._vehicle.control.pose.set(pose)

    # -- settings

    async def config_get(self, params: methods.ConfigGet, caller: Caller) -> results.Setting:
        """See ``FlightService``."""
        return self._settings.get(params.path)

    async def config_set(self, params: methods.ConfigSet, caller: Caller) -> results.Setting:
        """See ``FlightService``."""
        setting = self._settings.set(params)
        self._journal.event("config.set", f"{params.path} = {setting['value']}")
        log.info("config_set", path=params.path, value=setting["value"], pid=caller.pid, uid=caller.uid)
        return setting

    # -- helpers

    @property
    def _commander(self) -> Commander:
        return self._vehicle.commander

    def _entry(self, goal_id: str) -> GoalEntry:
        entry = self._vehicle.trajectory.book.find(goal_id)
        if entry is None:
            raise ProtocolError(ErrorCode.UNKNOWN_GOAL, f"no goal {goal_id!r} is known", "goal_id")
        return entry

    async def _done(self, request: Callable[[], Awaitable[None]]) -> results.VehicleDone:
        try:
            await request()
        except NotPossibleError as error:
            raise ProtocolError(ErrorCode.WRONG_STATE, str(error)) from None
        except CommandRefusedError as error:
            raise ProtocolError(ErrorCode.AUTOPILOT_REFUSED, str(error)) from None
        except CommandTimeoutError as error:
            raise ProtocolError(ErrorCode.TIMED_OUT, str(error)) from None
        except NotConnectedError:
            raise ProtocolError(ErrorCode.WRONG_STATE, "no autopilot is connected") from None
        status = self._vehicle.autopilot.status.value
        return {
            "state": self._commander.state.value,
            "mode": status.mode.value,
            "armed": status.armed,
            "landed": LandedState(status.landed).name.lower(),
        }

    def _needs_engage(self) -> bool:
        """Whether a goal has to take the vehicle first. Raises when it cannot be flown in this state."""
        if self._vehicle.stopping:
            raise ProtocolError(ErrorCode.WRONG_STATE, "the daemon is stopping")
        state = self._commander.state
        engages = state is State.READY and self._vehicle.config.goals.engage_on_submit
        try:
            self._commander.require_no_other_mode()
            if engages:
                self._commander.require_engageable()
        except NotPossibleError as error:
            raise ProtocolError(ErrorCode.WRONG_STATE, str(error)) from None
        if state in FLYING:
            return False
        if engages or state is State.ENGAGING:
            return True
        hint = {
            State.DISCONNECTED: "no autopilot is connected",
            State.STANDBY: "the vehicle is on the ground; take off first",
            State.READY: "the vehicle is in Hold; engage it first",
            State.PILOT: "somebody else has the vehicle; engage it first",
            State.FAULT: "the daemon let the vehicle go; engage it first",
        }.get(state, "wait until it is done")
        raise ProtocolError(ErrorCode.WRONG_STATE, f"cannot fly a goal in state {state.value}: {hint}")

    async def _heard_if_it_engages(self) -> None:
        try:
            if self._commander.state is State.READY and self._vehicle.config.goals.engage_on_submit:
                await self._commander.until_heard("engage")
        except NotPossibleError as error:
            raise ProtocolError(ErrorCode.WRONG_STATE, str(error)) from None

    async def _engage_for(self, goal_id: str) -> None:
        try:
            await self._commander.engaged(lambda: self._vehicle.trajectory.goal_id == goal_id)
        except (NotPossibleError, CommandRefusedError, CommandTimeoutError, NotConnectedError) as error:
            if self._vehicle.trajectory.goal_id == goal_id:
                self._journal.event("engage_refused", str(error), goal_id)
            self._vehicle.trajectory.abort(goal_id, "engage_refused")

    def _place(self) -> orders.Place:
        record = self._vehicle.control.record.value
        if record is None or record.estimate.newest is None:
            raise ProtocolError(ErrorCode.WRONG_STATE, "there is no estimate of where the vehicle is")
        here = pipeline.at_rest(record.estimate.newest, record.now_s)
        return orders.Place(
            flown=record.reference or here,
            here=here,
            status=self._vehicle.autopilot.status.value,
            fence=self._vehicle.fence,
            max_distance_m=self._vehicle.config.guidance.max_distance_m,
            limits=self._vehicle.parameters.value.limits,
            parameters=self._vehicle.guidance,
        )
