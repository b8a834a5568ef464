"""What the autopilot says of itself: on the ground, in its Hold in the air, in offboard."""

from dataclasses import replace
from math import inf

from daemon.messages import AutopilotStatus, FlightMode, LandedState, SystemStatus

ON_GROUND = AutopilotStatus(
    connected=True,
    heard=True,
    told_s=inf,
    mode=FlightMode.HOLD,
    intended_mode=FlightMode.HOLD,
    armed=False,
    landed=LandedState.ON_GROUND,
    system_status=SystemStatus.STANDBY,
)
IN_HOLD = replace(ON_GROUND, armed=True, landed=LandedState.IN_AIR, system_status=SystemStatus.ACTIVE)
IN_OFFBOARD = replace(IN_HOLD, mode=FlightMode.OFFBOARD, intended_mode=FlightMode.OFFBOARD)
