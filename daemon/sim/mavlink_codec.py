"""MAVLink 2 bytes to and from field dicts, by pymavlink; with two messages that its dialects lack.

Names as in the MAVLink definition. Going out, a missing field is zero and None is NaN. Texts are str, byte arrays may
be hexadecimal text. Integer parameters are packed bytewise into the float, as PX4 does.
"""

import struct
from typing import Any

from pymavlink.dialects.v20 import development as dialect

Fields = dict[str, Any]

_FORMATS = {"char": "s", "uint8_t": "B", "int8_t": "b", "uint16_t": "H", "int16_t": "h", "uint32_t": "I",
            "int32_t": "i", "uint64_t": "Q", "int64_t": "q", "float": "f", "double": "d"}  # fmt: skip
_PARAM_FORMATS = {1: "<B", 2: "<b", 3: "<H", 4: "<h", 5: "<I", 6: "<i"}  # MAV_PARAM_TYPE


_Field = tuple[str, int, str]  # name, array length (0: a single value), struct code

# MAVLink's common definition has these two, pymavlink's dialects do not: id, checksum seed, fields in wire order.
_EXTRA: dict[str, tuple[int, int, tuple[_Field, ...]]] = {
    "EVENT": (
        410,
        160,
        (
            ("id", 0, "I"),
            ("event_time_boot_ms", 0, "I"),
            ("sequence", 0, "H"),
            ("destination_component", 0, "B"),
            ("destination_system", 0, "B"),
            ("log_levels", 0, "B"),
            ("arguments", 40, "B"),
        ),
    ),
    "CURRENT_EVENT_SEQUENCE": (411, 106, (("sequence", 0, "H"), ("flags", 0, "B"))),
}


def _definition(name: str) -> tuple[int, int, tuple[_Field, ...]]:
    if name in _EXTRA:
        return _EXTRA[name]
    cls = dialect.mavlink_map.get(getattr(dialect, f"MAVLINK_MSG_ID_{name}", -1))
    if cls is None:
        raise KeyError(name)
    types = dict(zip(cls.fieldnames, cls.fieldtypes, strict=True))
    lengths = zip(cls.ordered_fieldnames, cls.array_lengths, strict=True)
    return cls.id, cls.crc_extra, tuple((field, length, _FORMATS[types[field]]) for field, length in lengths)


class _Layout:
    """How one message is packed."""

    def __init__(self, name: str) -> None:
        self.message_id, self.crc_extra, self.fields = _definition(name)
        self.struct = struct.Struct("<" + "".join(f"{length or ''}{code}" for _, length, code in self.fields))

    def payload(self, fields: Fields) -> bytes:
        values: list[Any] = []
        for name, length, code in self.fields:
            value = fields.get(name, 0)
            if code == "s":
                values.append(value.encode() if isinstance(value, str) else b"")
            elif length:
                values += _array(value, length, code)
            else:
                values.append(_scalar(value, code))
        return self.struct.pack(*values)


def _scalar(value: Any, code: str) -> Any:
    if value is None:
        return float("nan") if code in "fd" else 0
    return value if code in "fd" else int(value)


def _array(value: Any, length: int, code: str) -> list[Any]:
    if isinstance(value, str):
        value = bytes.fromhex(value)
    items = list(value) if value else []
    return [_scalar(item, code) for item in items[:length]] + [0] * (length - len(items))


class MavlinkCodec:
    """One end of a MAVLink 2 link: ``encode`` numbers its packets, ``decode`` keeps what is left of a packet."""

    def __init__(self, system_id: int, component_id: int = 1) -> None:
        self.system_id = system_id
        self.component_id = component_id
        self._sequence = 0
        self._layouts: dict[str, _Layout] = {}
        self._parser = dialect.MAVLink(None)
        self._parser.robust_parsing = True

    def encode(self, name: str, fields: Fields) -> bytes:
        """One packet; KeyError for a message that nobody has defined."""
        layout = self._layouts.get(name)
        if layout is None:
            layout = self._layouts[name] = _Layout(name)
        if name in ("PARAM_VALUE", "PARAM_SET"):
            fields = fields | {"param_value": pack_parameter(fields["param_value"], fields["param_type"])}
        return self._frame(layout.message_id, layout.crc_extra, layout.payload(fields))

    def _frame(self, message_id: int, crc_extra: int, payload: bytes) -> bytes:
        payload = payload.rstrip(b"\0") or b"\0"  # MAVLink 2 cuts trailing zeros, but leaves one byte
        header = struct.pack(
            "<BBBBBBHB",
            len(payload), 0, 0, self._sequence, self.system_id, self.component_id,
            message_id & 0xFFFF, message_id >> 16,
        )  # fmt: skip
        self._sequence = (self._sequence + 1) & 0xFF
        crc = dialect.x25crc(header + payload + bytes((crc_extra,))).crc
        return b"\xfd" + header + payload + struct.pack("<H", crc)

    def decode(self, data: bytes) -> list[tuple[str, Fields, int, int]]:
        """Name, fields, system and component of the sender, of each whole message; what cannot be read is dropped."""
        messages = []
        for message in self._parser.parse_buffer(data) or []:
            name = message.get_type()
            if name in ("BAD_DATA", "PROTOCOL_ERROR") or name.startswith("UNKNOWN"):
                continue
            fields = message.to_dict()
            del fields["mavpackettype"]
            if name in ("PARAM_VALUE", "PARAM_SET"):
                fields["param_value"] = unpack_parameter(fields["param_value"], fields["param_type"])
            messages.append((name, fields, message.get_srcSystem(), message.get_srcComponent()))
        return messages


def pack_parameter(value: float | int, param_type: int) -> float:
    """The float in which a parameter travels."""
    layout = _PARAM_FORMATS.get(param_type)
    if layout is None:
        return float(value)
    packed: float = struct.unpack("<f", struct.pack(layout, int(value)).ljust(4, b"\0"))[0]
    return packed


def unpack_parameter(value: float, param_type: int) -> float | int:
    """The parameter that travelled in a float."""
    layout = _PARAM_FORMATS.get(param_type)
    if layout is None:
        return value
    unpacked: int = struct.unpack_from(layout, struct.pack("<f", value))[0]
    return unpacked
