"""The fields of PX4's messages as they were recorded, and what the session asks for."""

from typing import Any

from daemon.autopilot.session import Px4Session

HOLD, OFFBOARD, RETURN, LAND = 0x03040000, 0x00060000, 0x05040000, 0x06040000


def heartbeat(custom_mode: int = HOLD, *, armed: bool = True, system_status: int = 4, **more: Any) -> dict[str, Any]:
    fields = {
        "type": 2, "autopilot": 12, "base_mode": 157 if armed else 29, "custom_mode": custom_mode,
        "system_status": system_status, "mavlink_version": 3,
    }  # fmt: skip
    return fields | more


def current_mode(custom: int, intended: int | None = None) -> dict[str, Any]:
    return {"standard_mode": 0, "custom_mode": custom, "intended_custom_mode": custom if intended is None else intended}


def odometry(stamp_us: int, x: float = 0.0, **more: Any) -> dict[str, Any]:
    fields = {
        "time_usec": stamp_us, "frame_id": 1, "child_frame_id": 1, "x": x, "y": 0.0, "z": 0.0,
        "q": [1.0, 0.0, 0.0, 0.0], "vx": 0.0, "vy": 0.0, "vz": 0.0, "rollspeed": 0.0, "pitchspeed": 0.0,
        "yawspeed": 0.0, "pose_covariance": [0.04] * 21, "velocity_covariance": [0.01] * 21, "reset_counter": 11,
    }  # fmt: skip
    return fields | more


def ack(command: int, result: int, **more: Any) -> dict[str, Any]:
    return {"command": command, "result": result, "target_system": 1, "target_component": 195} | more


def requested_ids(session: Px4Session, command: int = 511) -> set[int]:
    return {int(f["param1"]) for _, f in session.take_outgoing() if f.get("command") == command}
