"""pymavlink alone: one thread that receives until the next setpoint is due, then echoes the newest ODOMETRY."""

import time

from pymavlink import mavutil  # MAVLink 2 by MAVLINK20=1, which the harness sets

from daemon.bench.contestants.common import PERIOD_S, PORT, SECONDS, WARM_UP_S, Meter, thrust_of


def main() -> None:
    """Connect, echo, measure."""
    link = mavutil.mavlink_connection(
        f"udpin:127.0.0.1:{PORT}", source_system=245, source_component=191, dialect="common"
    )
    link.wait_heartbeat()
    x_m = link.recv_match(type="ODOMETRY", blocking=True).x
    link.mav.command_long_send(1, 1, 176, 0, 1, 6, 0, 0, 0, 0, 0)
    due_s, meter = time.monotonic(), None
    warm_s = due_s + WARM_UP_S
    while (now_s := time.monotonic()) < warm_s + SECONDS:
        if meter is None and now_s >= warm_s:
            meter = Meter()
        if now_s < due_s:
            message = link.recv_match(blocking=True, timeout=due_s - now_s)
            if message is not None and message.get_type() == "ODOMETRY":
                x_m = message.x
            continue
        thrust = thrust_of(x_m)
        link.mav.set_attitude_target_send(0, 1, 1, 128, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0, thrust)
        due_s += PERIOD_S
    if meter is not None:
        meter.done()


main()
