"""The parameters that the simulation knows, with PX4's defaults; indices as in recordings of PX4 1.17."""

from dataclasses import dataclass
from typing import Any

REAL32 = 9
INT32 = 6
COUNT = 889
_NO_INDEX = 65535  # MAVLink: not known
DOES_NOT_EXIST = 1

# name: (value, index); a Python int is an INT32, a float a REAL32
_DEFAULTS: dict[str, tuple[float | int, int]] = {
    "BAT_CRIT_THR": (0.07, _NO_INDEX),
    "BAT_EMERGEN_THR": (0.05, _NO_INDEX),
    "BAT_LOW_THR": (0.15, _NO_INDEX),
    "CAL_BARO0_OFF": (-4.88281, 44),
    "CBRK_SUPPLY_CHK": (894281, _NO_INDEX),
    "COM_ARM_WO_GPS": (2, _NO_INDEX),
    "COM_DISARM_LAND": (2.0, 258),
    "COM_DISARM_PRFLT": (10.0, 260),
    "COM_FAIL_ACT_T": (5.0, _NO_INDEX),
    "COM_KILL_DISARM": (5.0, _NO_INDEX),
    "COM_LOW_BAT_ACT": (3, _NO_INDEX),
    "COM_OBL_RC_ACT": (0, 286),
    "COM_OF_LOSS_T": (1.0, 287),
    "COM_RC_IN_MODE": (4, 297),
    "COM_RC_LOSS_T": (0.5, _NO_INDEX),
    "COM_RC_OVERRIDE": (1, 299),
    "COM_SPOOLUP_TIME": (1.0, _NO_INDEX),
    "EKF2_HGT_REF": (1, 379),
    "MAV_SYS_ID": (1, _NO_INDEX),
    "MAV_TYPE": (2, _NO_INDEX),
    "MC_PITCHRATE_MAX": (220.0, 534),
    "MC_ROLLRATE_MAX": (220.0, 542),
    "MC_YAWRATE_MAX": (200.0, 560),
    "MIS_TAKEOFF_ALT": (2.5, 569),
    "MPC_LAND_CRWL": (0.3, _NO_INDEX),
    "MPC_LAND_SPEED": (0.7, 593),
    "MPC_THR_HOVER": (0.5, 600),
    "MPC_THR_MIN": (0.12, _NO_INDEX),
    "MPC_TILTMAX_AIR": (45.0, 604),
    "MPC_TKO_RAMP_T": (3.0, _NO_INDEX),
    "MPC_TKO_SPEED": (1.5, 607),
    "MPC_XY_CRUISE": (5.0, _NO_INDEX),
    "MPC_XY_VEL_MAX": (12.0, 622),
    "MPC_Z_VEL_MAX_DN": (1.5, _NO_INDEX),
    "MPC_Z_VEL_MAX_UP": (3.0, _NO_INDEX),
    "NAV_ACC_RAD": (2.0, _NO_INDEX),
    "NAV_DLL_ACT": (0, _NO_INDEX),
    "NAV_RCL_ACT": (2, _NO_INDEX),
    "RTL_CONE_ANG": (45, _NO_INDEX),
    "RTL_MIN_DIST": (10.0, _NO_INDEX),
    "RTL_RETURN_ALT": (30.0, _NO_INDEX),
    "SIM_BAT_DRAIN": (0.0, _NO_INDEX),
    "SIM_BAT_MIN_PCT": (50.0, _NO_INDEX),
    "SIM_GPS_USED": (10, _NO_INDEX),
    "SYS_AUTOSTART": (10040, 863),
    "THR_MDL_FAC": (0.0, 879),
}


@dataclass(slots=True)
class _Parameter:
    value: float | int
    index: int


class Parameters:
    """Parameter store; values are plain attributes of the vehicle's behaviour, read by name when they matter."""

    def __init__(self, overrides: dict[str, float | int]) -> None:
        self._table = {name: _Parameter(value, index) for name, (value, index) in _DEFAULTS.items()}
        for name, value in overrides.items():
            self.set(name, value)

    def __getitem__(self, name: str) -> float:
        return self._table[name].value

    def __contains__(self, name: str) -> bool:
        return name in self._table

    def set(self, name: str, value: float | int) -> None:
        """Take a value as it is; PX4 does not check ranges. Raises KeyError for an unknown name."""
        parameter = self._table[name]
        parameter.value = int(value) if isinstance(parameter.value, int) else float(value)

    def message(self, name: str) -> dict[str, Any]:
        """PARAM_VALUE; an INT32's value is the integer (the encoder packs it bytewise)."""
        parameter = self._table[name]
        return {
            "param_id": name,
            "param_value": parameter.value,
            "param_type": INT32 if isinstance(parameter.value, int) else REAL32,
            "param_count": COUNT,
            "param_index": parameter.index,
        }
