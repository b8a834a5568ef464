"""Which messages PX4 sends and how often: defaults of the onboard link, SET_MESSAGE_INTERVAL, its sending loop.

PX4's sender wakes every few milliseconds, looks at each stream and sends what is due and new. Here it wakes on the
4 ms simulation grid, on average every 10 ms, or as often as the fastest stream asks. A stream that is due is sent
with the newest sample that has made its way: that gives the recorded 8 and 16 ms steps of ODOMETRY's stamps.
"""

from collections.abc import Callable

STEP_US = 4000
_SLOWEST_LOOP_US = 10_000

# MAVLink id: (name, default interval in us on the onboard link, 0 = not sent unless asked for)
TABLE: dict[int, tuple[str, int]] = {
    0: ("HEARTBEAT", 1_000_000),
    1: ("SYS_STATUS", 200_000),
    2: ("SYSTEM_TIME", 1_000_000),
    4: ("PING", 1_000_000),
    24: ("GPS_RAW_INT", 125_000),
    30: ("ATTITUDE", 10_000),
    31: ("ATTITUDE_QUATERNION", 20_000),
    32: ("LOCAL_POSITION_NED", 33_333),
    33: ("GLOBAL_POSITION_INT", 20_000),
    36: ("SERVO_OUTPUT_RAW", 100_000),
    42: ("MISSION_CURRENT", 1_000_000),
    49: ("GPS_GLOBAL_ORIGIN", 0),
    74: ("VFR_HUD", 100_000),
    83: ("ATTITUDE_TARGET", 100_000),
    105: ("HIGHRES_IMU", 20_000),
    111: ("TIMESYNC", 100_000),
    115: ("HIL_STATE_QUATERNION", 0),
    141: ("ALTITUDE", 100_000),
    147: ("BATTERY_STATUS", 2_000_000),
    230: ("ESTIMATOR_STATUS", 1_000_000),
    242: ("HOME_POSITION", 2_000_000),
    245: ("EXTENDED_SYS_STATE", 200_000),
    331: ("ODOMETRY", 33_333),
    375: ("ACTUATOR_OUTPUT_STATUS", 0),
    411: ("CURRENT_EVENT_SEQUENCE", 3_000_000),
    436: ("CURRENT_MODE", 2_000_000),
}


class Streams:
    """When each message is due."""

    def __init__(self) -> None:
        self._intervals_us = {identifier: interval for identifier, (_, interval) in TABLE.items()}
        self._sent_us: dict[int, float] = {}
        self._active: list[tuple[int, str, int]] = []
        self._loop_us = _SLOWEST_LOOP_US
        self._next_loop_us = 0.0
        self._rebuild()

    def set_interval(self, identifier: int, interval_us: float) -> bool:
        """SET_MESSAGE_INTERVAL: -1 stops, 0 restores the default. False for a message that is not known."""
        if identifier not in TABLE:
            return False
        if interval_us < 0.0:
            self._intervals_us[identifier] = 0
        else:
            self._intervals_us[identifier] = int(interval_us) or TABLE[identifier][1]
        self._rebuild()
        return True

    def interval(self, identifier: int) -> int:
        """GET_MESSAGE_INTERVAL: microseconds, -1 when the message is not sent or not known."""
        return self._intervals_us.get(identifier, 0) or -1

    def due(self, now_us: int, has_news: Callable[[str], bool]) -> list[str]:
        """Names of the messages to be sent at this step; one without news waits, due or not."""
        if now_us < self._next_loop_us:
            return []
        self._next_loop_us += self._loop_us
        if self._next_loop_us < now_us:
            self._next_loop_us = now_us + self._loop_us
        slack_us = 0.3 * self._loop_us
        sent, names = self._sent_us, []
        for identifier, name, interval_us in self._active:
            last_us = sent[identifier]
            waited_us = now_us - last_us
            if waited_us > interval_us - slack_us and has_news(name):
                sent[identifier] = last_us + interval_us if waited_us < 1.5 * interval_us else now_us
                names.append(name)
        return names

    def _rebuild(self) -> None:
        active = [(i, TABLE[i][0], interval) for i, interval in self._intervals_us.items() if interval > 0]
        for identifier, _, interval_us in active:
            self._sent_us.setdefault(identifier, -float(interval_us))
        self._active = active
        fastest_us = min(interval for _, _, interval in active)
        self._loop_us = max(STEP_US, min(_SLOWEST_LOOP_US, fastest_us))
