"""The packer against pymavlink's own packer and parser."""

from math import isnan

import pytest
from pymavlink.dialects.v20 import development as dialect

from daemon.sim.mavlink_codec import MavlinkCodec, pack_parameter, unpack_parameter

MESSAGES = {
    "HEARTBEAT": {"type": 2, "autopilot": 12, "base_mode": 157, "custom_mode": 50593792, "system_status": 4,
                  "mavlink_version": 3},
    "COMMAND_ACK": {"command": 176, "result": 1, "progress": 0, "result_param2": 0, "target_system": 1,
                    "target_component": 195},
    "STATUSTEXT": {"severity": 4, "text": "Failsafe activated\t", "id": 0, "chunk_seq": 0},
    "CURRENT_MODE": {"standard_mode": 0, "custom_mode": 84148224, "intended_custom_mode": 393216},
    "HOME_POSITION": {"latitude": 473977436, "longitude": -85455940, "altitude": 489397, "x": -0.5, "y": 0.25, "z": 8.0,
                      "q": [1.0, 0.0, 0.0, 0.0], "approach_x": 0.0, "approach_y": 0.0, "approach_z": 0.0,
                      "time_usec": 3828000},
}  # fmt: skip


@pytest.mark.parametrize("name", MESSAGES)
def test_packets_are_those_of_pymavlink(name: str) -> None:
    fields = MESSAGES[name]
    cls = dialect.mavlink_map[getattr(dialect, f"MAVLINK_MSG_ID_{name}")]
    arguments = [v.encode() if isinstance(v, str) else v for v in (fields[n] for n in cls.fieldnames)]
    assert MavlinkCodec(3).encode(name, fields) == cls(*arguments).pack(dialect.MAVLink(None, 3, 1))


@pytest.mark.parametrize("name", MESSAGES)
def test_fields_come_back_as_they_went(name: str) -> None:
    packet = MavlinkCodec(3, 1).encode(name, MESSAGES[name])
    ((got_name, fields, system_id, component_id),) = MavlinkCodec(255).decode(packet)
    assert (got_name, fields, system_id, component_id) == (name, MESSAGES[name], 3, 1)


def test_packets_are_numbered_and_a_split_packet_is_joined() -> None:
    codec, parser = MavlinkCodec(1), MavlinkCodec(2)
    packets = [codec.encode("HEARTBEAT", MESSAGES["HEARTBEAT"]) for _ in range(300)]
    assert [packet[4] for packet in packets] == [number % 256 for number in range(300)]
    assert parser.decode(packets[0][:7]) == []
    assert len(parser.decode(packets[0][7:] + packets[1])) == 2


def test_what_cannot_be_read_is_dropped() -> None:
    packet = bytearray(MavlinkCodec(1).encode("HEARTBEAT", MESSAGES["HEARTBEAT"]))
    packet[12] ^= 0xFF
    parser = MavlinkCodec(2)
    assert parser.decode(b"garbage") == []
    assert parser.decode(bytes(packet)) == []
    assert len(parser.decode(MavlinkCodec(1).encode("HEARTBEAT", MESSAGES["HEARTBEAT"]))) == 1


def test_none_is_nan_and_a_missing_field_is_zero() -> None:
    ((_, fields, _, _),) = MavlinkCodec(1).decode(MavlinkCodec(1).encode("ODOMETRY", {"x": None, "q": [1, 0, 0, 0]}))
    assert isnan(fields["x"])
    assert fields["y"] == 0.0
    assert fields["velocity_covariance"] == [0.0] * 21


@pytest.mark.parametrize(("value", "param_type"), [(10040, 6), (-5, 6), (3, 1), (-3, 2), (0.5, 9)])
def test_parameters_survive_their_float(value: float, param_type: int) -> None:
    assert unpack_parameter(pack_parameter(value, param_type), param_type) == value


def test_a_message_that_nobody_has_defined_is_an_error() -> None:
    with pytest.raises(KeyError, match="NO_SUCH"):
        MavlinkCodec(1).encode("NO_SUCH", {})


def test_a_message_of_zeros_keeps_one_byte_of_them() -> None:
    packet = MavlinkCodec(1).encode("HEARTBEAT", {})
    assert packet[1] == 1
    assert len(MavlinkCodec(2).decode(packet)) == 1
