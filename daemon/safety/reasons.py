"""The reasons of the supervisor, and of goals that end, and what the estimation tells, in words."""

REASONS = {
    "start": "no autopilot has been heard since the daemon started",
    "connected": "the autopilot is connected, the vehicle is on the ground",
    "found_flying": "the vehicle was flying when the daemon met it; engage or hold it to take it",
    "link_returned": "the link was lost while the vehicle was ours, and is back; engage or hold it to take it",
    "pilot_takeoff": "the vehicle took off without being asked to by this daemon",
    "link_lost": "nothing is heard from the autopilot",
    "autopilot_rebooted": "the autopilot has restarted",
    "control_stalled": (
        "the control task fell silent, as on a computer that is too busy; "
        "the vehicle was handed over, engage it to take it again"
    ),
    "disarmed": "the vehicle is disarmed",
    "terminated": "the motors were stopped by a kill switch or by flight termination",
    "autopilot_failsafe": "a failsafe of the autopilot took the vehicle",
    "pilot_override": "somebody else changed the mode",
    "requested": "as requested",
    "engaged": "the vehicle is under the daemon's control",
    "engage_refused": "the autopilot did not go to offboard within 2 s",
    "released": "the vehicle is in Hold, as asked",
    "released_to_land": "the vehicle was handed over to land",
    "land_overtook_hold": "the Land that was asked for while Hold did not show came after it; Hold is asked for again",
    "release_failed": "the autopilot took neither Hold nor Land; the daemon is silent, the autopilot's failsafe acts",
    "estimate_lost": "the autopilot's estimate did not come any more",
    "estimate_poor": "the position estimate became too uncertain, or contradicted itself",
    "position_reset": "the position estimate came back from elsewhere; the old goal means nothing any more",
    "attitude_disagreement": "the autopilot's attitude and its accelerometer disagree",
    "tilt_excess": "the vehicle tilted too far",
    "speed_excess": "the vehicle became too fast",
    "geofence": "the vehicle left the hard fence",
    "not_followed": "the vehicle did not keep to its place or path; fly slower, or look for wind, load and gains",
    "link_slow": "the link takes longer there and back than the vehicle can be flown by; the autopilot holds it",
    "landed": "the vehicle is on the ground",
    "battery_low": "the battery is low",
    "goal": "a goal is being flown",
    "no_goal": "the vehicle holds its place",
    "taken_off": "the vehicle has taken off and is in Hold",
    # of goals only
    "timeout": "it took longer than its time limit",
    "stream_timeout": "no reference came from its client in time",
    "stopping": "the daemon was told to stop",
    "task_failed": "a part of the daemon failed; its log says which",
    "vehicle.hold": "Hold was asked for",
    "vehicle.land": "a landing was asked for",
    "vehicle.return": "the return was asked for",
    "vehicle.takeoff": "a take-off was asked for",
}

ESTIMATE_EVENTS = {
    "clock_stepped": "the autopilot's stamps jumped against this computer's clock; their new time is followed",
    "filter_restarted": "the filter began anew from the autopilot's odometry",
    "regained": "telemetry is back after a gap",
    "reset": "the autopilot counted a reset of its estimate, and nothing moved",
}
