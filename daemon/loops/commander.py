"""Vehicle requests as coroutines: check, ask, and wait until telemetry shows it. The newest request supersedes."""

from collections.abc import Callable

from daemon.autopilot.port import Autopilot
from daemon.latest import Latest
from daemon.loops import leave
from daemon.loops.asking import Asking, CommandTimeouts
from daemon.loops.engage import Engage
from daemon.loops.take_off import TakeOff
from daemon.messages import RequestKind, VehicleRequest
from daemon.pipeline import Inputs, Record
from daemon.safety.dead_man import SetpointGate
from daemon.safety.supervisor import FLYING, State


class Commander:
    """One request at a time: a newer one ends a pending one with ``NotPossibleError("superseded ...")``.

    A request that is refused at once ends none.
    """

    def __init__(
        self,
        autopilot: Autopilot,
        gate: SetpointGate,
        record: Latest[Record | None],
        request: Latest[VehicleRequest | None],
        timeouts: CommandTimeouts,
        cannot_hover: Callable[[], list[str]],
    ) -> None:
        self._asking = Asking(autopilot, record, request, timeouts)
        self._take_off = TakeOff(self._asking)
        self._engage = Engage(self._asking, gate, cannot_hover)
        self._flying = False

    # -- what is seen

    @property
    def state(self) -> State:
        """The supervisor's state."""
        return self._asking.state

    @property
    def read(self) -> bool:
        """Whether the supervisor has read the newest request."""
        return self._asking.read

    @property
    def releases(self) -> int:
        """See ``Asking``."""
        return self._asking.releases

    @property
    def standstills(self) -> int:
        """See ``Asking``."""
        return self._asking.standstills

    @property
    def stopping(self) -> bool:
        """See ``Asking``."""
        return self._asking.stopping

    # -- what is told

    def on_control_tick(self, inputs: Inputs, record: Record) -> None:
        """A listener of the control task: notes when the vehicle goes to somebody else, and who armed it."""
        flying = record.supervision.state in FLYING
        self._asking.releases += self._flying and not flying
        self._flying = flying
        self._take_off.armed_shows(inputs.status.armed)

    def stood_still(self) -> None:
        """End what would still arm, take off or engage: who asked has given up, and may stand beside the vehicle."""
        self._asking.standstills += 1
        self._asking.turns.stood_still()

    def stop(self) -> None:
        """The vehicle is neither armed nor engaged any more."""
        self._asking.stopping = True

    # -- requests

    async def arm(self) -> None:
        """See ``TakeOff``."""
        await self._take_off.arm()

    async def disarm(self) -> None:
        """See ``TakeOff``."""
        await self._take_off.disarm()

    async def stand_down(self, limit_s: float) -> None:
        """See ``TakeOff``."""
        await self._take_off.stand_down(limit_s)

    async def takeoff(self, altitude_m: float) -> None:
        """See ``TakeOff``."""
        await self._take_off.takeoff(altitude_m)

    async def engage(self) -> None:
        """See ``Engage``."""
        await self._engage.engage()

    def ask_engage(self) -> None:
        """See ``Engage.ask``."""
        self._engage.ask()

    async def engaged(self, wanted: Callable[[], bool]) -> None:
        """See ``Engage.ended``."""
        await self._engage.ended(wanted)

    def require_no_other_mode(self) -> None:
        """See ``Engage``."""
        self._engage.require_no_other_mode()

    def require_engageable(self) -> None:
        """See ``Engage``."""
        self._engage.require_engageable()

    async def hold(self) -> None:
        """See ``leave``."""
        await leave.hold(self._asking)

    async def land(self) -> None:
        """See ``leave``."""
        await leave.land(self._asking)

    async def return_home(self) -> None:
        """See ``leave``."""
        await leave.return_home(self._asking)

    def post(self, kind: RequestKind) -> None:
        """See ``Asking``."""
        self._asking.post(kind)

    async def until_heard(self, what: str) -> None:
        """See ``Asking``."""
        await self._asking.until_heard(what)

    async def wait_for(self, done: Callable[[], bool], limit_s: float, what: str) -> None:
        """See ``Asking``."""
        await self._asking.wait_for(done, limit_s, what)
