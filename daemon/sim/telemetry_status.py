"""Fields of the messages about modes, health and outputs: MAVLink's definition, values of recordings of PX4 1.17."""

from math import nan
from typing import TYPE_CHECKING

from daemon.sim.modes import STANDARD_MODE, base_mode, custom_mode
from daemon.sim.sample import Fields, Sample

if TYPE_CHECKING:
    from daemon.sim.px4 import SimulatedPx4

_SENSORS_PRESENT = 0x100402F
_SENSORS_ENABLED = 0x101402F
_HEALTH = 0x1320C83F
_HEALTH_PREARM, _HEALTH_POSITION, _HEALTH_MAG, _HEALTH_BATTERY = 0x10000000, 0x4000, 0x4, 0x2000000
_FLAGS_GROUND, _FLAGS_FLYING, _FLAGS_NO_POSITION, _FLAGS_NO_FUSION, _FLAGS_BOOT = 1023, 895, 869, 101, 229


def heartbeat(px4: "SimulatedPx4", sample: Sample) -> Fields:
    """HEARTBEAT."""
    commander, (mode, _) = px4.commander, px4.told
    return {
        "type": int(px4.parameters["MAV_TYPE"]),
        "autopilot": 12,
        "base_mode": base_mode(mode, commander.armed),
        "custom_mode": custom_mode(mode),
        "system_status": int(commander.status),
        "mavlink_version": 3,
    }


def current_mode(px4: "SimulatedPx4", sample: Sample) -> Fields:
    """CURRENT_MODE: actual and intended mode."""
    mode, intended = px4.told
    return {
        "standard_mode": STANDARD_MODE.get(mode, 0),
        "custom_mode": custom_mode(mode),
        "intended_custom_mode": custom_mode(intended),
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
    if commander.monitor.battery_warning:
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
        "charge_state": 1 + int(px4.commander.monitor.battery_warning),
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
