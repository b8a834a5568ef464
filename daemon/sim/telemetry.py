"""The fields of every message that PX4 streams, as in the MAVLink definition and in recordings of PX4 1.17."""

from collections.abc import Callable
from dataclasses import dataclass
from math import degrees, hypot, isfinite, nan
from typing import TYPE_CHECKING, Any

from daemon.frames import add, clamp, to_rpy, yaw_of
from daemon.messages import Vec3
from daemon.sim.estimator import Estimate
from daemon.sim.modes import STANDARD_MODE, base_mode, custom_mode
from daemon.sim.sensors import global_of
from daemon.sim.vehicle import VehicleState

if TYPE_CHECKING:
    from daemon.sim.px4 import SimulatedPx4

Fields = dict[str, Any]

_SENSORS_PRESENT = 0x100402F
_SENSORS_ENABLED = 0x101402F
_HEALTH = 0x1320C83F
_HEALTH_PREARM, _HEALTH_POSITION, _HEALTH_MAG, _HEALTH_BATTERY = 0x10000000, 0x4000, 0x4, 0x2000000
_FLAGS_GROUND, _FLAGS_FLYING, _FLAGS_NO_POSITION, _FLAGS_NO_FUSION, _FLAGS_BOOT = 1023, 895, 869, 101, 229


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """Estimate, filtered body rates and truth of one moment, as they wait to be sent."""

    stamp_us: int
    estimate: Estimate
    rates_frd_rad_s: Vec3
    truth: VehicleState


def odometry(px4: "SimulatedPx4", sample: Sample) -> Fields:
    """ODOMETRY: local NED pose, NED velocity (child_frame_id 1), body rates, covariances, reset counter."""
    estimate = sample.estimate
    x, y, z = estimate.position_ned_m
    vx, vy, vz = estimate.velocity_ned_m_s
    p, q, r = sample.rates_frd_rad_s
    variance = estimate.position_variance_m2
    pose, velocity = [0.0] * 21, [0.0] * 21
    pose[0] = pose[6] = variance
    pose[11] = px4.height_variance_m2
    pose[15] = pose[18] = 2.0e-4
    pose[20] = 2.8e-3
    velocity[0] = velocity[6] = 0.0088 + 0.2 * max(0.0, variance - 0.05)
    velocity[11] = 0.0013
    return {
        "time_usec": sample.stamp_us,
        "frame_id": 1,
        "child_frame_id": 1,
        "x": x,
        "y": y,
        "z": z,
        "q": list(estimate.attitude_wb),
        "vx": vx,
        "vy": vy,
        "vz": vz,
        "rollspeed": p,
        "pitchspeed": q,
        "yawspeed": r,
        "pose_covariance": pose,
        "velocity_covariance": velocity,
        "reset_counter": estimate.reset_counter,
        "estimator_type": 8,
        "quality": 0,
    }


def local_position(px4: "SimulatedPx4", sample: Sample) -> Fields:
    """LOCAL_POSITION_NED."""
    x, y, z = sample.estimate.position_ned_m
    vx, vy, vz = sample.estimate.velocity_ned_m_s
    return {"time_boot_ms": sample.stamp_us // 1000, "x": x, "y": y, "z": z, "vx": vx, "vy": vy, "vz": vz}


def global_position(px4: "SimulatedPx4", sample: Sample) -> Fields:
    """GLOBAL_POSITION_INT: 1e-7 degrees, millimetres, cm/s, 1/100 degree."""
    place = global_of(add(sample.estimate.position_ned_m, px4.estimator.origin_ned_m), px4.home)
    vx, vy, vz = sample.estimate.velocity_ned_m_s
    return {
        "time_boot_ms": sample.stamp_us // 1000,
        "lat": round(place.latitude_deg * 1e7),
        "lon": round(place.longitude_deg * 1e7),
        "alt": round(place.altitude_amsl_m * 1e3),
        "relative_alt": round((px4.home_local_m[2] - sample.estimate.position_ned_m[2]) * 1e3),
        "vx": round(vx * 100.0),
        "vy": round(vy * 100.0),
        "vz": round(vz * 100.0),
        "hdg": round(degrees(yaw_of(sample.estimate.attitude_wb)) % 360.0 * 100.0) % 36000,
    }


def attitude(px4: "SimulatedPx4", sample: Sample) -> Fields:
    """ATTITUDE."""
    roll, pitch, yaw = to_rpy(sample.estimate.attitude_wb)
    p, q, r = sample.rates_frd_rad_s
    stamp_ms = sample.stamp_us // 1000
    return {
        "time_boot_ms": stamp_ms,
        "roll": roll,
        "pitch": pitch,
        "yaw": yaw,
        "rollspeed": p,
        "pitchspeed": q,
        "yawspeed": r,
    }


def attitude_quaternion(px4: "SimulatedPx4", sample: Sample) -> Fields:
    """ATTITUDE_QUATERNION."""
    q1, q2, q3, q4 = sample.estimate.attitude_wb
    p, q, r = sample.rates_frd_rad_s
    return {
        "time_boot_ms": sample.stamp_us // 1000,
        "q1": q1,
        "q2": q2,
        "q3": q3,
        "q4": q4,
        "rollspeed": p,
        "pitchspeed": q,
        "yawspeed": r,
        "repr_offset_q": [0.0, 0.0, 0.0, 0.0],
    }


def highres_imu(px4: "SimulatedPx4", sample: Sample) -> Fields:
    """HIGHRES_IMU: specific force, rates, magnetic field, barometer."""
    force, rates, field = px4.sensors.imu(sample.truth)
    altitude_m = px4.home.altitude_amsl_m - sample.truth.position_ned_m[2]
    return {
        "time_usec": sample.stamp_us,
        "xacc": force[0],
        "yacc": force[1],
        "zacc": force[2],
        "xgyro": rates[0],
        "ygyro": rates[1],
        "zgyro": rates[2],
        "xmag": field[0],
        "ymag": field[1],
        "zmag": field[2],
        "abs_pressure": 1013.25 * (1.0 - 2.25577e-5 * altitude_m) ** 5.25588,
        "diff_pressure": 0.0,
        "pressure_alt": altitude_m,
        "temperature": 15.0,
        "fields_updated": 6719,
        "id": 0,
    }


def truth(px4: "SimulatedPx4", sample: Sample) -> Fields:
    """HIL_STATE_QUATERNION: the simulated truth, quantized to 1 cm and 1 cm/s; its stamp is always 0, as in PX4."""
    state = px4.truth
    place = global_of(state.position_ned_m, px4.home)
    vx, vy, vz = state.velocity_ned_m_s
    p, q, r = state.rates_frd_rad_s
    return {
        "time_usec": 0,
        "attitude_quaternion": list(state.attitude_wb),
        "rollspeed": p,
        "pitchspeed": q,
        "yawspeed": r,
        "lat": round(place.latitude_deg * 1e7),
        "lon": round(place.longitude_deg * 1e7),
        "alt": round(place.altitude_amsl_m * 1e3),
        "vx": round(vx * 100.0),
        "vy": round(vy * 100.0),
        "vz": round(vz * 100.0),
        "ind_airspeed": 0,
        "true_airspeed": 0,
        "xacc": 0,
        "yacc": 0,
        "zacc": 0,
    }


def attitude_target(px4: "SimulatedPx4", sample: Sample) -> Fields:
    """ATTITUDE_TARGET: rates and thrust that are flown; in rate offboard its stamp stands still, as in PX4."""
    p, q, r = px4.setpoint.rates_frd_rad_s
    return {
        "time_boot_ms": px4.attitude_setpoint_ms,
        "type_mask": 0,
        "q": list(sample.estimate.attitude_wb),
        "body_roll_rate": p,
        "body_pitch_rate": q,
        "body_yaw_rate": r,
        "thrust": px4.setpoint.thrust,
    }


def heartbeat(px4: "SimulatedPx4", sample: Sample) -> Fields:
    """HEARTBEAT."""
    commander = px4.commander
    return {
        "type": 2,
        "autopilot": 12,
        "base_mode": base_mode(commander.mode, commander.armed),
        "custom_mode": custom_mode(commander.mode),
        "system_status": int(commander.status),
        "mavlink_version": 3,
    }


def current_mode(px4: "SimulatedPx4", sample: Sample) -> Fields:
    """CURRENT_MODE: actual and intended mode."""
    commander = px4.commander
    return {
        "standard_mode": STANDARD_MODE.get(commander.mode, 0),
        "custom_mode": custom_mode(commander.mode),
        "intended_custom_mode": custom_mode(commander.intended),
    }


def extended_sys_state(px4: "SimulatedPx4", sample: Sample) -> Fields:
    """EXTENDED_SYS_STATE."""
    return {"vtol_state": 0, "landed_state": int(px4.commander.landed_state)}


def sys_status(px4: "SimulatedPx4", sample: Sample) -> Fields:
    """SYS_STATUS: health bits and battery."""
    commander, battery = px4.commander, px4.battery
    health = _HEALTH
    if not (commander.armed or commander.can_arm):
        health &= ~_HEALTH_PREARM
    if not px4.position_valid:
        health &= ~_HEALTH_POSITION
    if px4.estimator.heading_fault:
        health &= ~(_HEALTH_MAG | _HEALTH_PREARM)
    if commander.battery_warning:
        health &= ~_HEALTH_BATTERY
    return {
        "onboard_control_sensors_present": _SENSORS_PRESENT,
        "onboard_control_sensors_enabled": _SENSORS_ENABLED,
        "onboard_control_sensors_health": health,
        "load": 100,
        "voltage_battery": round(battery.voltage_v * 1e3),
        "current_battery": -100,
        "battery_remaining": round(battery.fraction * 100.0),
        "drop_rate_comm": 0,
        "errors_comm": 0,
        "errors_count1": 0,
        "errors_count2": 0,
        "errors_count3": 0,
        "errors_count4": 0,
        "onboard_control_sensors_present_extended": 0,
        "onboard_control_sensors_enabled_extended": 0,
        "onboard_control_sensors_health_extended": 1,
    }


def battery_status(px4: "SimulatedPx4", sample: Sample) -> Fields:
    """BATTERY_STATUS; charge_state 1 fine, 2 low, 3 critical, 4 emergency."""
    battery = px4.battery
    return {
        "id": 0,
        "battery_function": 1,
        "type": 1,
        "temperature": 32767,
        "voltages": [round(battery.voltage_v * 1e3)] + [65535] * 9,
        "current_battery": -100,
        "current_consumed": -4,
        "energy_consumed": -1,
        "battery_remaining": round(battery.fraction * 100.0),
        "time_remaining": 0,
        "charge_state": 1 + int(px4.commander.battery_warning),
        "voltages_ext": [0, 0, 0, 0],
        "mode": 0,
        "fault_bitmask": 0,
    }


def estimator_status(px4: "SimulatedPx4", sample: Sample) -> Fields:
    """ESTIMATOR_STATUS: flags as recorded on the ground, in flight, without GPS, after boot."""
    estimator = px4.estimator
    flags = _FLAGS_GROUND if px4.commander.detector.landed else _FLAGS_FLYING
    if not px4.position_valid:
        flags = _FLAGS_NO_POSITION if estimator.fusing else _FLAGS_NO_FUSION
    if not px4.heading_stable:
        flags = _FLAGS_BOOT
    return {
        "time_usec": sample.stamp_us,
        "flags": flags,
        "vel_ratio": 0.05,
        "pos_horiz_ratio": 0.01,
        "pos_vert_ratio": 0.05,
        "mag_ratio": 0.1,
        "hagl_ratio": 0.05,
        "tas_ratio": nan,
        "pos_horiz_accuracy": (2.0 * sample.estimate.position_variance_m2) ** 0.5,
        "pos_vert_accuracy": px4.height_variance_m2**0.5,
    }


def gps_raw_int(px4: "SimulatedPx4", sample: Sample) -> Fields:
    """GPS_RAW_INT: fix_type 3 with ten satellites, or 0 without GPS."""
    place = global_of(px4.truth.position_ned_m, px4.home)
    vx, vy, _ = px4.truth.velocity_ned_m_s
    fix = px4.estimator.gps
    return {
        "time_usec": 0,
        "fix_type": 3 if fix else 0,
        "lat": round(place.latitude_deg * 1e7),
        "lon": round(place.longitude_deg * 1e7),
        "alt": round(place.altitude_amsl_m * 1e3),
        "eph": 70,
        "epv": 110,
        "vel": min(65534, round(hypot(vx, vy) * 100.0)),
        "cog": 0,
        "satellites_visible": 10 if fix else 0,
        "alt_ellipsoid": round(place.altitude_amsl_m * 1e3),
        "h_acc": 900,
        "v_acc": 1780,
        "vel_acc": 400,
        "hdg_acc": 0,
        "yaw": 0,
    }


def home_position(px4: "SimulatedPx4", sample: Sample) -> Fields:
    """HOME_POSITION; its local numbers stay when the origin moves, as in PX4."""
    place = px4.home_global
    return {
        "latitude": round(place.latitude_deg * 1e7),
        "longitude": round(place.longitude_deg * 1e7),
        "altitude": round(place.altitude_amsl_m * 1e3),
        "x": px4.home_local_m[0],
        "y": px4.home_local_m[1],
        "z": px4.home_local_m[2],
        "q": [1.0, 0.0, 0.0, 0.0],
        "approach_x": 0.0,
        "approach_y": 0.0,
        "approach_z": 0.0,
        "time_usec": sample.stamp_us,
    }


def gps_global_origin(px4: "SimulatedPx4", sample: Sample) -> Fields:
    """GPS_GLOBAL_ORIGIN: where the local frame has its zero."""
    place = global_of(px4.estimator.origin_ned_m, px4.home)
    return {
        "latitude": round(place.latitude_deg * 1e7),
        "longitude": round(place.longitude_deg * 1e7),
        "altitude": round(place.altitude_amsl_m * 1e3),
        "time_usec": sample.stamp_us,
    }


def altitude(px4: "SimulatedPx4", sample: Sample) -> Fields:
    """ALTITUDE."""
    local_m = -sample.estimate.position_ned_m[2]
    amsl_m = px4.home.altitude_amsl_m + local_m - px4.estimator.origin_ned_m[2]
    return {
        "time_usec": sample.stamp_us,
        "altitude_monotonic": amsl_m,
        "altitude_amsl": amsl_m,
        "altitude_local": local_m,
        "altitude_relative": local_m + px4.home_local_m[2],
        "altitude_terrain": px4.home.altitude_amsl_m,
        "bottom_clearance": px4.height_m,
    }


def vfr_hud(px4: "SimulatedPx4", sample: Sample) -> Fields:
    """VFR_HUD."""
    thrust = px4.setpoint.thrust
    vx, vy, vz = sample.estimate.velocity_ned_m_s
    return {
        "airspeed": nan,
        "groundspeed": hypot(vx, vy),
        "heading": round(degrees(yaw_of(sample.estimate.attitude_wb))) % 360,
        "throttle": round(clamp(thrust, 0.0, 1.0) * 100.0) if isfinite(thrust) else 0,
        "alt": px4.home.altitude_amsl_m - px4.estimator.origin_ned_m[2] - sample.estimate.position_ned_m[2],
        "climb": -vz,
    }


def _rotor_microseconds(px4: "SimulatedPx4") -> list[int]:
    """PWM of SIH: 900 off, 1000 to 2000 over the signal."""
    if not px4.commander.armed:
        return [900] * len(px4.signals)
    return [round(1000.0 + 1000.0 * signal) for signal in px4.signals]


def servo_output_raw(px4: "SimulatedPx4", sample: Sample) -> Fields:
    """SERVO_OUTPUT_RAW, microseconds."""
    values = (_rotor_microseconds(px4) + [900] * 16)[:16]
    fields: Fields = {"time_usec": sample.stamp_us, "port": 0}
    fields.update({f"servo{i + 1}_raw": value for i, value in enumerate(values)})
    return fields


def actuator_output_status(px4: "SimulatedPx4", sample: Sample) -> Fields:
    """ACTUATOR_OUTPUT_STATUS."""
    values = ([float(v) for v in _rotor_microseconds(px4)] + [900.0] * 16)[:16] + [0.0] * 16
    return {"time_usec": sample.stamp_us, "active": 16, "actuator": values}


def timesync(px4: "SimulatedPx4", sample: Sample) -> Fields:
    """TIMESYNC, PX4 asking."""
    return {"tc1": 0, "ts1": px4.time_us * 1000}


def ping(px4: "SimulatedPx4", sample: Sample) -> Fields:
    """PING, PX4 asking everybody."""
    return {"time_usec": px4.time_us, "seq": px4.time_us // 1_000_000, "target_system": 0, "target_component": 0}


def system_time(px4: "SimulatedPx4", sample: Sample) -> Fields:
    """SYSTEM_TIME; the calendar is made up, so that runs repeat."""
    return {"time_unix_usec": 1_700_000_000_000_000 + px4.time_us, "time_boot_ms": px4.time_us // 1000}


def mission_current(px4: "SimulatedPx4", sample: Sample) -> Fields:
    """MISSION_CURRENT: there is no mission."""
    return {"seq": 0, "total": 65535, "mission_state": 1, "mission_mode": 2}


def current_event_sequence(px4: "SimulatedPx4", sample: Sample) -> Fields:
    """CURRENT_EVENT_SEQUENCE."""
    return {"sequence": px4.announcer.sequence, "flags": 0}


MESSAGES: dict[str, Callable[["SimulatedPx4", Sample], Fields]] = {
    "ACTUATOR_OUTPUT_STATUS": actuator_output_status,
    "ALTITUDE": altitude,
    "ATTITUDE": attitude,
    "ATTITUDE_QUATERNION": attitude_quaternion,
    "ATTITUDE_TARGET": attitude_target,
    "BATTERY_STATUS": battery_status,
    "CURRENT_EVENT_SEQUENCE": current_event_sequence,
    "CURRENT_MODE": current_mode,
    "ESTIMATOR_STATUS": estimator_status,
    "EXTENDED_SYS_STATE": extended_sys_state,
    "GLOBAL_POSITION_INT": global_position,
    "GPS_GLOBAL_ORIGIN": gps_global_origin,
    "GPS_RAW_INT": gps_raw_int,
    "HEARTBEAT": heartbeat,
    "HIGHRES_IMU": highres_imu,
    "HIL_STATE_QUATERNION": truth,
    "HOME_POSITION": home_position,
    "LOCAL_POSITION_NED": local_position,
    "MISSION_CURRENT": mission_current,
    "ODOMETRY": odometry,
    "PING": ping,
    "SERVO_OUTPUT_RAW": servo_output_raw,
    "SYS_STATUS": sys_status,
    "SYSTEM_TIME": system_time,
    "TIMESYNC": timesync,
    "VFR_HUD": vfr_hud,
}
