"""PX4's failsafe in time: the delay in Hold, a user's take-over, and a lost pilot that is not forgiven by itself.

After ``FailsafeBase::update``, ``checkFailsafe`` and ``clearDelayIfNeeded`` (``src/modules/commander/failsafe``).
"""

from dataclasses import replace

from daemon.messages import FlightMode
from daemon.sim.failsafe import Action, Cause, Health, decide, without_causes
from daemon.sim.parameters import Parameters

_BEYOND_HOLD = frozenset((FlightMode.RETURN, FlightMode.LAND))


class FailsafeState:
    """``action``: what is decided; while ``holding`` the vehicle waits in Hold before it is carried out."""

    def __init__(self, parameters: Parameters) -> None:
        self._parameters = parameters
        self.action = Action()
        self._delay_s = 0.0
        self._taken_over: Cause | None = None
        self._manual_control_lost = False

    @property
    def holding(self) -> bool:
        """Whether PX4 holds before it acts."""
        return self._delay_s > 0.0 and self.action.mode is not None

    @property
    def flown(self) -> FlightMode | None:
        """The mode that the failsafe flies now; None: the intended one."""
        return FlightMode.HOLD if self.holding else self.action.mode

    def taken_over(self, health: Health) -> None:
        """A user has changed the mode: that ends a failsafe until there is a new reason."""
        if self.action.mode is not None:
            self._taken_over = self.action.cause
        self._manual_control_lost = health.manual_control_lost
        self.action, self._delay_s = Action(), 0.0

    def cleared(self) -> None:
        """Disarmed: all is forgotten."""
        self.action, self._delay_s = Action(), 0.0
        self._taken_over, self._manual_control_lost = None, False

    def step(self, intended: FlightMode, health: Health, dt_s: float) -> None:
        """Decide anew."""
        self._delay_s = max(0.0, self._delay_s - dt_s)
        self._manual_control_lost |= health.manual_control_lost
        if self._manual_control_lost is not health.manual_control_lost:
            health = replace(health, manual_control_lost=True)
        action = self._decide(intended, health)
        if self._taken_over is not None:
            if action.cause is not self._taken_over:
                self._taken_over = None
            else:
                action = self._decide(intended, without_causes(health))
        is_new = action.cause is not self.action.cause or self.action.mode is None
        if self.action.mode in _BEYOND_HOLD and not self.holding:
            self._delay_s = 0.0
        elif action.delayed and is_new and self._delay_s == 0.0:
            self._delay_s = self._parameters["COM_FAIL_ACT_T"]
        elif not action.delayed:
            self._delay_s = 0.0
        self.action = action

    def _decide(self, intended: FlightMode, health: Health) -> Action:
        p = self._parameters
        return decide(
            intended,
            health,
            offboard_loss=int(p["COM_OBL_RC_ACT"]),
            manual_loss=int(p["NAV_RCL_ACT"]),
            low_battery=int(p["COM_LOW_BAT_ACT"]),
        )
