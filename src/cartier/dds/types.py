"""ROS 2 message types: objects and CDR bytes by rosbags' type store, and the DDS types that belong to them.

cyclonedds would turn each byte of an image into a Python integer; so it knows the type alone, and the
bytes pass through.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any

from cyclonedds.idl import make_idl_struct
from cyclonedds.idl import types as idl

from cartier.errors import InputError, brief
from cartier.io.ros_messages import DEFINITIONS

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

CANCEL_GOAL = "action_msgs/srv/CancelGoal_Request"
WORDS = {"string": str, "bool": bool, "byte": idl.byte, "char": idl.uint8} | {
    f"{kind}{bits}": getattr(idl, f"{kind}{bits}")
    for kind, sizes in (("int", (8, 16, 32, 64)), ("uint", (8, 16, 32, 64)), ("float", (32, 64)))
    for bits in sizes
}


@cache
def store() -> Typestore:
    """The message types of ROS 2 Jazzy, and ``DEFINITIONS``."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    types = get_typestore(Stores.ROS2_JAZZY)
    for name, definition in DEFINITIONS.items():
        types.register(get_types_from_msg(definition, name))
    (fields,) = get_types_from_msg("action_msgs/msg/GoalInfo goal_info", "a/msg/b").values()
    types.register({CANCEL_GOAL: fields})  # rosbags would file a service's request among the messages
    return types


def message(kind: str, **fields: Any) -> Any:
    """A message by its type, such as ``std_msgs/msg/String``."""
    return store().types[kind](**fields)


def header(frame: str, stamp_ns: int = 0) -> Any:
    """A std_msgs/Header; time zero stands for the latest transform there is."""
    seconds, nanoseconds = divmod(stamp_ns, 10**9)
    stamp = message("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)
    return message("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


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
