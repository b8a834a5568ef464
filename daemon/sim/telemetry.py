"""Which function fills which message that PX4 streams."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from daemon.sim import telemetry_motion as motion
from daemon.sim import telemetry_status as status
from daemon.sim.sample import Fields, Sample

if TYPE_CHECKING:
    from daemon.sim.px4 import SimulatedPx4

MESSAGES: dict[str, Callable[["SimulatedPx4", Sample], Fields]] = {
    "ACTUATOR_OUTPUT_STATUS": status.actuator_output_status,
    "ALTITUDE": motion.altitude,
    "ATTITUDE": motion.attitude,
    "ATTITUDE_QUATERNION": motion.attitude_quaternion,
    "ATTITUDE_TARGET": motion.attitude_target,
    "BATTERY_STATUS": status.battery_status,
    "CURRENT_EVENT_SEQUENCE": status.current_event_sequence,
    "CURRENT_MODE": status.current_mode,
    "ESTIMATOR_STATUS": status.estimator_status,
    "EXTENDED_SYS_STATE": status.extended_sys_state,
    "GLOBAL_POSITION_INT": motion.global_position,
    "GPS_GLOBAL_ORIGIN": motion.gps_global_origin,
    "GPS_RAW_INT": motion.gps_raw_int,
    "HEARTBEAT": status.heartbeat,
    "HIGHRES_IMU": motion.highres_imu,
    "HIL_STATE_QUATERNION": motion.truth,
    "HOME_POSITION": motion.home_position,
    "LOCAL_POSITION_NED": motion.local_position,
    "MISSION_CURRENT": status.mission_current,
    "ODOMETRY": motion.odometry,
    "PING": status.ping,
    "SERVO_OUTPUT_RAW": status.servo_output_raw,
    "SYS_STATUS": status.sys_status,
    "SYSTEM_TIME": status.system_time,
    "TIMESYNC": status.timesync,
    "VFR_HUD": motion.vfr_hud,
}
