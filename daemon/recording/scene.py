"""The flight for the eye: Foxglove's own messages, so that a 3D view works without set-up.

Viewers want z up: the world is ``map`` (east, north, up), the body ``base_link`` (forward, left, up).
"""

from collections import deque

from foxglove import Context
from foxglove.channels import (
    FrameTransformsChannel,
    LocationFixChannel,
    LogChannel,
    PoseInFrameChannel,
    PosesInFrameChannel,
)
from foxglove.messages import (
    FrameTransform,
    FrameTransforms,
    LocationFix,
    Log,
    LogLevel,
    Pose,
    PoseInFrame,
    PosesInFrame,
    Quaternion,
    Timestamp,
    Vector3,
)

from daemon import frames
from daemon.messages import IDENTITY, GlobalPosition, Quat, Vec3
from daemon.pipeline import Record

WORLD, BODY, WANTED = "map", "base_link", "reference"
PATH_SPACING_S = 0.1  # between poses of the flown path
PATH_EVERY_S = 1.0  # how often the flown path is written


def pose_enu(position_ned_m: Vec3, attitude_wb: Quat) -> tuple[Vector3, Quaternion]:
    """Place and attitude as viewers want them."""
    e, n, u = frames.ned_from_enu(position_ned_m)
    w, x, y, z = frames.attitude_ned_from_enu(attitude_wb)  # its own inverse
    return Vector3(x=e, y=n, z=u), Quaternion(x=x, y=y, z=z, w=w)


class Scene:
    """Poses, paths, transforms, place on the map and log lines. ``path_poses``: length of the flown path's history."""

    def __init__(self, context: Context, path_poses: int) -> None:
        self._transforms = FrameTransformsChannel("/tf", context=context)
        self._pose = PoseInFrameChannel("/pose", context=context)
        self._reference = PoseInFrameChannel("/reference/pose", context=context)
        self._flown = PosesInFrameChannel("/path/flown", context=context)
        self._planned = PosesInFrameChannel("/path/planned", context=context)
        self._location = LocationFixChannel("/location", context=context)
        self._log = LogChannel("/log", context=context)
        self._path: deque[Pose] = deque(maxlen=path_poses)
        self._path_due_s = self._spacing_due_s = float("-inf")

    def show(self, record: Record, ns: int) -> None:
        """Where the vehicle is and where it is wanted."""
        stamp = Timestamp.from_epoch_secs(ns / 1e9)
        transforms = []
        state = record.estimate.newest
        if state is not None:
            place, attitude = pose_enu(state.position_ned_m, state.attitude_wb)
            pose = Pose(position=place, orientation=attitude)
            self._pose.log(PoseInFrame(timestamp=stamp, frame_id=WORLD, pose=pose), log_time=ns)
            transforms.append(_transform(stamp, BODY, place, attitude))
            self._history(record.now_s, pose, stamp, ns)
        wanted = record.reference
        if wanted is not None:
            place, attitude = pose_enu(wanted.position_ned_m, frames.from_yaw(wanted.yaw_rad))
            pose = Pose(position=place, orientation=attitude)
            self._reference.log(PoseInFrame(timestamp=stamp, frame_id=WORLD, pose=pose), log_time=ns)
            transforms.append(_transform(stamp, WANTED, place, attitude))
        if transforms:
            self._transforms.log(FrameTransforms(transforms=transforms), log_time=ns)

    def plan(self, positions_ned_m: list[Vec3], ns: int) -> None:
        """The path that was planned."""
        level = Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)
        poses = [Pose(position=pose_enu(p, IDENTITY)[0], orientation=level) for p in positions_ned_m]
        stamp = Timestamp.from_epoch_secs(ns / 1e9)
        self._planned.log(PosesInFrame(timestamp=stamp, frame_id=WORLD, poses=poses), log_time=ns)

    def locate(self, position: GlobalPosition | None, ns: int) -> None:
        """The place on the map."""
        if position is not None:
            fix = LocationFix(
                timestamp=Timestamp.from_epoch_secs(ns / 1e9),
                frame_id=BODY,
                latitude=position.latitude_deg,
                longitude=position.longitude_deg,
                altitude=position.altitude_amsl_m,
            )
            self._location.log(fix, log_time=ns)

    def tell(self, name: str, text: str, ns: int) -> None:
        """A line of log."""
        stamp = Timestamp.from_epoch_secs(ns / 1e9)
        self._log.log(Log(timestamp=stamp, level=LogLevel.Info, name=name, message=text), log_time=ns)

    def _history(self, now_s: float, pose: Pose, stamp: Timestamp, ns: int) -> None:
        if now_s >= self._spacing_due_s:
            self._spacing_due_s = now_s + PATH_SPACING_S
            self._path.append(pose)
        if now_s >= self._path_due_s:
            self._path_due_s = now_s + PATH_EVERY_S
            self._flown.log(PosesInFrame(timestamp=stamp, frame_id=WORLD, poses=list(self._path)), log_time=ns)


def _transform(stamp: Timestamp, child: str, place: Vector3, attitude: Quaternion) -> FrameTransform:
    return FrameTransform(
        timestamp=stamp,
        parent_frame_id=WORLD,
        child_frame_id=child,
        translation=place,
        rotation=attitude,
    )
