"""Whether PX4 takes itself to be on the ground: early at take-off, late at landing, as recorded."""

_TAKEOFF_DETECTED_S = 0.9  # after the take-off command, long before the vehicle leaves the ground
_LIFTED_S = 0.1
_LOW_THRUST_SHARE = 0.9  # of hover: more than that on the ground is a take-off under way
_PATIENCE_S = (1.3, 2.5)  # recorded: contact is believed after 1.3 to 7.4 s


def patience(chance: float) -> float:
    """Seconds until ground contact is believed; ``chance`` is a standard normal number (1.0: 3.8 s)."""
    quickest_s, spread_s = _PATIENCE_S
    return quickest_s + spread_s * abs(chance)


class LandDetector:
    """``landed`` as PX4 believes it. ``patience_s``: how long contact takes to be believed."""

    def __init__(self, patience_s: float) -> None:
        self._patience_s = patience_s
        self.landed = True
        self._taking_off_s = 0.0
        self._lifted_s = 0.0
        self._contact_s = 0.0

    def step(self, dt_s: float, *, on_ground: bool, taking_off: bool, armed: bool, thrust_share: float) -> bool | None:
        """The new belief when it changed, else None; ``thrust_share`` is thrust over hover thrust."""
        self._taking_off_s = self._taking_off_s + dt_s if taking_off and armed else 0.0
        self._lifted_s = 0.0 if on_ground else self._lifted_s + dt_s
        resting = on_ground and (not armed or thrust_share < _LOW_THRUST_SHARE) and not taking_off
        self._contact_s = self._contact_s + dt_s if resting else 0.0
        before = self.landed
        if before and (self._taking_off_s > _TAKEOFF_DETECTED_S or self._lifted_s > _LIFTED_S):
            self.landed = False
        elif not before and self._contact_s > self._patience_s:
            self.landed = True
        return self.landed if self.landed != before else None
