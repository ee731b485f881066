"""ROS 2 message types: objects and CDR bytes by rosbags' type store, and the DDS types that belong to them.

cyclonedds would turn each byte of an image into a Python integer; so it knows the type alone, and the
bytes pass through.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

from cyclonedds.idl import make_idl_struct
from cyclonedds.idl import types as idl

from cartier.errors import InputError, brief
from cartier_ros.messages import DEFINITIONS

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

CANCEL_GOAL = "action_msgs/srv/CancelGoal_Request"
ACTION = "nav2_msgs/action/NavigateToPose"
SERVICES = {  # the parts of services and actions are messages; those of Jazzy and Kilted
    "lifecycle_msgs/srv/GetState_Request": "uint8 structure_needs_at_least_one_member",
    "lifecycle_msgs/srv/GetState_Response": "lifecycle_msgs/State current_state",
    CANCEL_GOAL: "action_msgs/GoalInfo goal_info",
    "action_msgs/srv/CancelGoal_Response": "int8 return_code\naction_msgs/GoalInfo[] goals_canceling",
    f"{ACTION}_Goal": "geometry_msgs/PoseStamped pose\nstring behavior_tree",
    f"{ACTION}_Result": "uint16 error_code\nstring error_msg",  # Jazzy's readers pass over the message
    f"{ACTION}_Feedback": "geometry_msgs/PoseStamped current_pose\nbuiltin_interfaces/Duration navigation_time\n"
    "builtin_interfaces/Duration estimated_time_remaining\nint16 number_of_recoveries\nfloat32 distance_remaining",
    f"{ACTION}_SendGoal_Request": f"unique_identifier_msgs/UUID goal_id\n{ACTION}_Goal goal",
    f"{ACTION}_SendGoal_Response": "bool accepted\nbuiltin_interfaces/Time stamp",
    f"{ACTION}_GetResult_Request": "unique_identifier_msgs/UUID goal_id",
    f"{ACTION}_GetResult_Response": f"int8 status\n{ACTION}_Result result",
    f"{ACTION}_FeedbackMessage": f"unique_identifier_msgs/UUID goal_id\n{ACTION}_Feedback feedback",
}
WORDS = {"string": str, "bool": bool, "byte": idl.byte, "char": idl.uint8} | {
    f"{kind}{bits}": getattr(idl, f"{kind}{bits}")
    for kind, sizes in (("int", (8, 16, 32, 64)), ("uint", (8, 16, 32, 64)), ("float", (32, 64)))
    for bits in sizes
}


@cache
def store() -> Typestore:
    """The message types of ROS 2 Jazzy, ``DEFINITIONS``, and the parts of Nav2's action."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    types = get_typestore(Stores.ROS2_JAZZY)
    for name, definition in DEFINITIONS.items():
        types.register(get_types_from_msg(definition, name))
    for name, definition in SERVICES.items():
        (fields,) = get_types_from_msg(definition, "a/msg/b").values()
        types.register({name: fields})  # rosbags would file a service's parts among the messages
    return types


def message(kind: str, **fields: Any) -> Any:
    """A message by its type, such as ``std_msgs/msg/String``."""
    return store().types[kind](**fields)


def header(frame: str, stamp_ns: int = 0) -> Any:
    """A std_msgs/Header; time zero stands for the latest transform there is."""
    return message("std_msgs/msg/Header", stamp=stamp(stamp_ns), frame_id=frame)


def stamp(stamp_ns: int) -> Any:
    """A builtin_interfaces/Time."""
    seconds, nanoseconds = divmod(stamp_ns, 10**9)
    return message("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)


def duration(seconds: float) -> Any:
    """A builtin_interfaces/Duration."""
    whole, nanoseconds = divmod(round(seconds * 10**9), 10**9)
    return message("builtin_interfaces/msg/Duration", sec=whole, nanosec=nanoseconds)


def pose_of(xyz: Sequence[float], yaw: float) -> Any:
    """A geometry_msgs/Pose that is turned about the vertical alone."""
    x, y, z = map(float, xyz)
    turn = message("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=math.sin(yaw / 2), w=math.cos(yaw / 2))
    return message(
        "geometry_msgs/msg/Pose", position=message("geometry_msgs/msg/Point", x=x, y=y, z=z), orientation=turn
    )


def pose_stamped(frame: str, pose: tuple[float, float, float], stamp_ns: int = 0) -> Any:
    """A geometry_msgs/PoseStamped of x, y (m) and yaw (rad)."""
    x, y, yaw = pose
    return message("geometry_msgs/msg/PoseStamped", header=header(frame, stamp_ns), pose=pose_of((x, y, 0.0), yaw))


def decode(cdr: bytes, kind: str) -> Any:
    """A message from its CDR bytes. Raises InputError for damaged ones."""
    try:
        return store().deserialize_cdr(cdr, kind)
    except Exception as error:  # rosbags raises whatever the bytes lead it to
        raise InputError(f"a message is no {kind}: {brief(error, 80)}") from error


def encoded(value: Any) -> bytes:
    """The CDR bytes of a message."""
    return bytes(store().serialize_cdr(value, value.__msgtype__))


def ros2_of(value: Any, kind: str) -> Any:
    """A ROS 1 message as the ROS 2 message of type ``kind``: fields by name, where ROS 1 may write capitals."""
    types = store()
    fields: dict[str, Any] = {}
    described: Any = types.fielddefs[kind][1]  # rosbags types an element as an enumeration's member or a string
    for name, (form, what) in described:
        old = getattr(value, name, None)
        old = getattr(value, name.upper(), None) if old is None else old
        if old is None:
            raise InputError(f"a ROS 1 message has no field {brief(name, 40)!r}, which {kind} has")
        if form.name == "NAME":
            old = ros2_of(old, what)
        elif form.name in ("SEQUENCE", "ARRAY") and what[0][0].name == "NAME":
            old = [ros2_of(each, what[0][1]) for each in old]
        fields[name] = old
    return types.types[kind](**fields)


def dds_name(kind: str) -> str:
    """The name of a type in DDS: ``std_msgs::msg::dds_::String_``."""
    package, group, name = kind.split("/")
    return f"{package}::{group}::dds_::{name}_"


def ros_name(name: str) -> str:
    """The ROS name of a type by its name in DDS; empty if it is none of ROS 2."""
    parts = name.split("::")
    right = len(parts) == 4 and parts[2] == "dds_" and parts[3].endswith("_")
    return f"{parts[0]}/{parts[1]}/{parts[3][:-1]}" if right else ""


class Bytes:
    """A message as its CDR bytes; cyclonedds notes on it whence it came."""

    sample_info: Any = None

    def __init__(self, data: bytes) -> None:
        self.data = data


@cache
def topic_type(kind: str) -> Any:
    """A DDS type that is never read field by field: what arrives is ``Bytes``, and ``as_sample`` makes what is sent."""
    made = _struct(kind)
    made.deserialize = made.deserialize_key = lambda data, **_: Bytes(data)
    made.serialize = lambda sample, **_: sample.cdr
    return made


def as_sample(kind: str, data: bytes) -> Any:
    """What a writer of ``topic_type(kind)`` takes: these CDR bytes."""
    made = topic_type(kind)
    sample = made.__new__(made)
    sample.cdr = data
    return sample


def _struct(kind: str) -> Any:
    fields = {name: _field(form) for name, form in store().fielddefs[kind][1]}
    return make_idl_struct(kind.rpartition("/")[2], dds_name(kind), fields)


def _field(form: Any) -> Any:
    what, detail = form
    if what.name == "BASE":
        return WORDS[detail[0]]
    if what.name == "NAME":
        return _struct_once(detail)
    inner, length = detail
    return idl.array[_field(inner), length] if what.name == "ARRAY" else idl.sequence[_field(inner)]


@cache
def _struct_once(kind: str) -> Any:
    return _struct(kind)
