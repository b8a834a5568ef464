"""Fields of the messages about motion and place, as in the MAVLink definition and in recordings of PX4 1.17."""

from math import degrees, hypot, isfinite, nan
from typing import TYPE_CHECKING

from daemon.frames import add, clamp, to_rpy, yaw_of
from daemon.sim.sample import Fields, Sample
from daemon.sim.sensors import global_of

if TYPE_CHECKING:
    from daemon.sim.px4 import SimulatedPx4


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
        "relative_alt": round((px4.navigator.home_local_m[2] - sample.estimate.position_ned_m[2]) * 1e3),
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
    p, q, r = px4.navigator.setpoint.rates_frd_rad_s
    return {
        "time_boot_ms": px4.navigator.attitude_setpoint_ms,
        "type_mask": 0,
        "q": list(sample.estimate.attitude_wb),
        "body_roll_rate": p,
        "body_pitch_rate": q,
        "body_yaw_rate": r,
        "thrust": px4.navigator.setpoint.thrust,
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
        "altitude_relative": local_m + px4.navigator.home_local_m[2],
        "altitude_terrain": px4.home.altitude_amsl_m,
        "bottom_clearance": px4.height_m,
    }


def vfr_hud(px4: "SimulatedPx4", sample: Sample) -> Fields:
    """VFR_HUD."""
    thrust = px4.navigator.setpoint.thrust
    vx, vy, vz = sample.estimate.velocity_ned_m_s
    return {
        "airspeed": nan,
        "groundspeed": hypot(vx, vy),
        "heading": round(degrees(yaw_of(sample.estimate.attitude_wb))) % 360,
        "throttle": round(clamp(thrust, 0.0, 1.0) * 100.0) if isfinite(thrust) else 0,
        "alt": px4.home.altitude_amsl_m - px4.estimator.origin_ned_m[2] - sample.estimate.position_ned_m[2],
        "climb": -vz,
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
    place = px4.navigator.home_global
    return {
        "latitude": round(place.latitude_deg * 1e7),
        "longitude": round(place.longitude_deg * 1e7),
        "altitude": round(place.altitude_amsl_m * 1e3),
        "x": px4.navigator.home_local_m[0],
        "y": px4.navigator.home_local_m[1],
        "z": px4.navigator.home_local_m[2],
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
