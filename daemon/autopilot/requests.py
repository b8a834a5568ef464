"""What was asked of the autopilot and waits for its answer: modes, commands, parameters, and why it refused; pure."""

from math import isfinite

from daemon.autopilot import events, param_reads
from daemon.autopilot.acks import CommandAcks, Done, ModeAcks
from daemon.autopilot.port import CommandTimeoutError, NotConnectedError
from daemon.autopilot.px4 import CMD_SET_MODE, Fields, Message
from daemon.messages import AutopilotStatus, FlightMode, ModeRefusal

_PARAM_DOES_NOT_EXIST = 1  # MAV_PARAM_ERROR; any other may be gone when asked again
_REASON_UPDATE_S = 0.2  # an EVENT that explains a refusal comes within a few ms of the ack; generous


class Requests:
    """``start_*`` and ``mode_requested`` note what is asked, the messages' own methods settle it.

    ``system_id``, ``component_id``: our own MAVLink ids, to know our acks from others'; 0 takes every ack.
    """

    def __init__(self, system_id: int, component_id: int) -> None:
        self._ids = (system_id, component_id)
        self._mode_acks = ModeAcks()
        self._commands = CommandAcks()
        self._param_reads = param_reads.ParamReads()
        self._reasons = events.Reasons()
        self._refused: tuple[int, FlightMode, float] | None = None

    # ---- asked

    def mode_requested(self, mode: FlightMode, now_s: float) -> None:
        """A mode was asked for, or is about to be: its acks are expected."""
        self._mode_acks.requested(mode, now_s)
        self._refused = None

    def start_command(self, message: Message, now_s: float, timeout_s: float, done: Done) -> None:
        """A command was sent: ``done`` is called with its error or None."""
        self._commands.start(message, now_s, timeout_s, done)

    def drop_command(self, done: Done) -> None:
        """Nobody waits for this command any more: it is not sent again."""
        self._commands.drop(done)

    def withdraw_commands(self) -> None:
        """End every command that waits for its acknowledgement: none is sent again."""
        self._commands.fail(CommandTimeoutError("the command was withdrawn before it was acknowledged"))

    def start_parameter(self, name: str, now_s: float, timeout_s: float, done: param_reads.Done) -> Message:
        """The message that asks for a parameter; ``done`` is called with it, None for an unknown one, or an error."""
        return self._param_reads.start(name, now_s, timeout_s, done)

    def forget(self, why: str) -> None:
        """Nothing that waits will be answered."""
        self._mode_acks.clear()
        self._commands.fail(NotConnectedError(why))
        self._param_reads.fail(NotConnectedError(why))

    def rebooted(self) -> None:
        """Nothing that waits will be answered, and what was said was said by another."""
        self._reasons = events.Reasons()
        self.forget("the autopilot has rebooted")

    # ---- time passes

    def commands_again(self, now_s: float, status: AutopilotStatus) -> list[Message]:
        """Commands to send again; what has waited too long ends."""

        def why_not_armed(result: int, refused_s: float) -> str:
            return self._reasons.why(result, status.intended_mode, refused_s)

        return self._commands.poll(now_s, why_not_armed, heard=status.heard)

    def parameters_again(self, now_s: float) -> list[Message]:
        """Parameters to ask for again; what has waited too long ends."""
        return self._param_reads.poll(now_s)

    def status_changed(self, before: AutopilotStatus, status: AutopilotStatus) -> None:
        """A command that another mode or arming has overtaken is not sent again."""
        if status.mode is not before.mode:
            self._commands.mode_changed(status.mode)
        if status.armed is not before.armed:
            self._commands.armed_changed(status.armed)

    # ---- answered

    def is_ours(self, fields: Fields) -> bool:
        """True for an ack of something that we asked for."""
        system, component = int(fields.get("target_system", 0)), int(fields.get("target_component", 0))
        our_system, our_component = self._ids
        return (not (system and our_system) or system == our_system) and (
            not (component and our_component) or component == our_component
        )

    def ack(self, command: int, result: int, now_s: float) -> ModeRefusal | None:
        """An ack of ours; the refusal of a mode if it is one."""
        if command != CMD_SET_MODE:
            self._commands.ack(command, result, now_s)
            return None
        mode = self._mode_acks.ack(result, now_s)
        if mode is None:
            return None
        self._refused = (result, mode, now_s)
        return self._refusal(now_s)

    def explained(self, event: events.Event, now_s: float) -> ModeRefusal | None:
        """An EVENT; the last refusal of a mode, when this says why it was."""
        self._reasons.note(event, now_s)
        if event.refusal and self._refused is not None and now_s - self._refused[2] <= _REASON_UPDATE_S:
            return self._refusal(now_s)
        return None

    def parameter(self, fields: Fields) -> None:
        """PARAM_VALUE."""
        value = fields["param_value"]
        if isinstance(value, int | float) and isfinite(value):
            self._param_reads.settle(str(fields["param_id"]), value)

    def parameter_error(self, fields: Fields) -> None:
        """PARAM_ERROR."""
        if int(fields["error"]) == _PARAM_DOES_NOT_EXIST:
            self._param_reads.settle(str(fields["param_id"]), None)

    def _refusal(self, now_s: float) -> ModeRefusal | None:
        if self._refused is None:
            return None
        result, mode, time_s = self._refused
        return ModeRefusal(mode, self._reasons.why(result, mode, now_s), time_s)
