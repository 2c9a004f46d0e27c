"""The ROS 2 messages as an independent DDS reads and writes them: ROS's own names of types and fields."""

from dataclasses import dataclass, field
from types import new_class

from cyclonedds.idl import IdlStruct
from cyclonedds.idl.annotations import final
from cyclonedds.idl.types import array, float32, float64, int8, int32, sequence, uint8, uint32


def message(package):
    """A class as the message of its name in `package`."""

    def wrap(cls):
        typename = f"{package}::msg::dds_::{cls.__name__}_"
        own = {key: value for key, value in vars(cls).items() if key in ("__annotations__", "__module__") or key in cls.__annotations__}
        made = new_class(cls.__name__, (IdlStruct,), {"typename": typename}, lambda made: made.update(own))
        return final(dataclass(made))

    return wrap


@message("builtin_interfaces")
class Time:
    sec: int32 = 0
    nanosec: uint32 = 0


@message("std_msgs")
class Header:
    stamp: Time = field(default_factory=Time)
    frame_id: str = ""


@message("std_msgs")
class Bool:
    data: bool = False


@message("geometry_msgs")
class Vector3:
    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0


@message("geometry_msgs")
class Point:
    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0


@message("geometry_msgs")
class Quaternion:
    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0
    w: float64 = 1.0


@message("geometry_msgs")
class Pose:
    position: Point = field(default_factory=Point)
    orientation: Quaternion = field(default_factory=Quaternion)


@message("geometry_msgs")
class PoseStamped:
    header: Header = field(default_factory=Header)
    pose: Pose = field(default_factory=Pose)


@message("geometry_msgs")
class PoseWithCovariance:
    pose: Pose
    covariance: array[float64, 36]


@message("geometry_msgs")
class Twist:
    linear: Vector3 = field(default_factory=Vector3)
    angular: Vector3 = field(default_factory=Vector3)


@message("geometry_msgs")
class TwistWithCovariance:
    twist: Twist
    covariance: array[float64, 36]


@message("nav_msgs")
class Odometry:
    header: Header
    child_frame_id: str
    pose: PoseWithCovariance
    twist: TwistWithCovariance


@message("geometry_msgs")
class Transform:
    translation: Vector3
    rotation: Quaternion


@message("geometry_msgs")
class TransformStamped:
    header: Header
    child_frame_id: str
    transform: Transform


@message("tf2_msgs")
class TFMessage:
    transforms: sequence[TransformStamped]


@message("sensor_msgs")
class Range:
    header: Header
    radiation_type: uint8
    field_of_view: float32
    min_range: float32
    max_range: float32
    range: float32


@message("sensor_msgs")
class BatteryState:
    header: Header
    voltage: float32
    temperature: float32
    current: float32
    charge: float32
    capacity: float32
    design_capacity: float32
    percentage: float32
    power_supply_status: uint8
    power_supply_health: uint8
    power_supply_technology: uint8
    present: bool
    cell_voltage: sequence[float32]
    cell_temperature: sequence[float32]
    location: str
    serial_number: str


@message("diagnostic_msgs")
class KeyValue:
    key: str
    value: str


@message("diagnostic_msgs")
class DiagnosticStatus:
    level: uint8
    name: str
    message: str
    hardware_id: str
    values: sequence[KeyValue]


@message("diagnostic_msgs")
class DiagnosticArray:
    header: Header
    status: sequence[DiagnosticStatus]


@message("nav_msgs")
class MapMetaData:
    map_load_time: Time
    resolution: float32
    width: uint32
    height: uint32
    origin: Pose


@message("nav_msgs")
class OccupancyGrid:
    header: Header
    info: MapMetaData
    data: sequence[int8]
