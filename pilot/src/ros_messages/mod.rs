//! The ROS 2 messages of recordings and of the node, with their definitions as MCAP carries them (encoding
//! `ros2msg`).
#![allow(missing_docs, reason = "the fields are those of ROS 2's definitions")]

mod conversions;

use serde::{Deserialize, Serialize};

/// A message with a definition.
pub trait Message: Serialize {
    /// `package/msg/Type`.
    const NAME: &'static str;
    /// Its definition, followed by those of the types it contains; empty where none is recorded.
    const DEFINITION: &'static str = "";
}

/// Frames of the rangefinders: front, right, left.
pub const RANGE_FRAMES: [&str; 3] = ["range_front", "range_right", "range_left"];

macro_rules! definition {
    ($own:literal $(, $name:literal: $text:expr)*) => {
        concat!($own $(, "\n================================================================================\nMSG: ",
            $name, "\n", $text)*)
    };
}

macro_rules! time {
    () => {
        "int32 sec\nuint32 nanosec"
    };
}
macro_rules! header {
    () => {
        "builtin_interfaces/Time stamp\nstring frame_id"
    };
}
macro_rules! xyz {
    () => {
        "float64 x\nfloat64 y\nfloat64 z"
    };
}
macro_rules! quaternion {
    () => {
        "float64 x\nfloat64 y\nfloat64 z\nfloat64 w"
    };
}
macro_rules! pose {
    () => {
        "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation"
    };
}

/// Seconds and nanoseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Time {
    pub sec: i32,
    pub nanosec: u32,
}

/// When, and in which frame.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Header {
    pub stamp: Time,
    pub frame_id: String,
}

/// A point or a vector.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct Xyz {
    pub x: f64,
    pub y: f64,
    pub z: f64,
}

/// A rotation.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct Quaternion {
    pub x: f64,
    pub y: f64,
    pub z: f64,
    pub w: f64,
}

impl Quaternion {
    /// Counter-clockwise about z.
    pub fn of_degrees(degrees: f64) -> Self {
        let (z, w) = (degrees.to_radians() / 2.0).sin_cos();
        Self {
            z,
            w,
            ..Self::default()
        }
    }

    /// The rotation about z, −180 to 180.
    pub fn degrees(self) -> f64 {
        let half = self.z.atan2(self.w).to_degrees();
        (2.0 * half + 180.0).rem_euclid(360.0) - 180.0
    }
}

/// Position, metres, and orientation.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct Pose {
    pub position: Xyz,
    pub orientation: Quaternion,
}

/// The reported pose.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct PoseStamped {
    pub header: Header,
    pub pose: Pose,
}

impl Message for PoseStamped {
    const NAME: &'static str = "geometry_msgs/msg/PoseStamped";
    const DEFINITION: &'static str = definition!(
        "std_msgs/Header header\ngeometry_msgs/Pose pose", "std_msgs/Header": header!(), "builtin_interfaces/Time": time!(),
        "geometry_msgs/Pose": pose!(), "geometry_msgs/Point": xyz!(), "geometry_msgs/Quaternion": quaternion!()
    );
}

/// Any text.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Text {
    pub data: String,
}

impl Message for Text {
    const NAME: &'static str = "std_msgs/msg/String";
    const DEFINITION: &'static str = "string data";
}

/// Where the robot is, and how fast. Covariances of zeros are unknown.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Odometry {
    pub header: Header,
    pub child_frame_id: String,
    pub pose: PoseWithCovariance,
    pub twist: TwistWithCovariance,
}

impl Message for Odometry {
    const NAME: &'static str = "nav_msgs/msg/Odometry";
}

/// A pose of [`Odometry`].
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct PoseWithCovariance {
    pub pose: Pose,
    pub covariance: [[f64; 6]; 6],
}

/// A velocity of [`Odometry`].
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct TwistWithCovariance {
    pub twist: Twist,
    pub covariance: [[f64; 6]; 6],
}

/// Velocity, m/s, and angular velocity, rad/s.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct Twist {
    pub linear: Xyz,
    pub angular: Xyz,
}

impl Message for Twist {
    const NAME: &'static str = "geometry_msgs/msg/Twist";
}

/// Whether something is so.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct Bool {
    pub data: bool,
}

impl Message for Bool {
    const NAME: &'static str = "std_msgs/msg/Bool";
}

#[allow(clippy::struct_field_names, reason = "the names of ROS 2")]
/// One rangefinder, metres; infinite without an echo (REP 117).
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Range {
    pub header: Header,
    pub radiation_type: u8,
    pub field_of_view: f32,
    pub min_range: f32,
    pub max_range: f32,
    pub range: f32,
}

impl Message for Range {
    const NAME: &'static str = "sensor_msgs/msg/Range";
    const DEFINITION: &'static str = definition!(
        "uint8 ULTRASOUND=0\nuint8 INFRARED=1\nstd_msgs/Header header\nuint8 radiation_type\nfloat32 field_of_view\n\
         float32 min_range\nfloat32 max_range\nfloat32 range",
        "std_msgs/Header": header!(), "builtin_interfaces/Time": time!()
    );
}

/// Translation, metres, and rotation.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct Transform {
    pub translation: Xyz,
    pub rotation: Quaternion,
}

/// From a frame to a child.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct TransformStamped {
    pub header: Header,
    pub child_frame_id: String,
    pub transform: Transform,
}

/// The frames.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct TfMessage {
    pub transforms: Vec<TransformStamped>,
}

impl Message for TfMessage {
    const NAME: &'static str = "tf2_msgs/msg/TFMessage";
    const DEFINITION: &'static str = definition!(
        "geometry_msgs/TransformStamped[] transforms",
        "geometry_msgs/TransformStamped": "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform",
        "std_msgs/Header": header!(), "builtin_interfaces/Time": time!(),
        "geometry_msgs/Transform": "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation",
        "geometry_msgs/Vector3": xyz!(), "geometry_msgs/Quaternion": quaternion!()
    );
}

/// The gyroscope's angle as an orientation; covariances whose first is −1 mark what is not known.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Imu {
    pub header: Header,
    pub orientation: Quaternion,
    pub orientation_covariance: [f64; 9],
    pub angular_velocity: Xyz,
    pub angular_velocity_covariance: [f64; 9],
    pub linear_acceleration: Xyz,
    pub linear_acceleration_covariance: [f64; 9],
}

impl Message for Imu {
    const NAME: &'static str = "sensor_msgs/msg/Imu";
    const DEFINITION: &'static str = definition!(
        "std_msgs/Header header\ngeometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n\
         geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n\
         geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance",
        "std_msgs/Header": header!(), "builtin_interfaces/Time": time!(), "geometry_msgs/Vector3": xyz!(),
        "geometry_msgs/Quaternion": quaternion!()
    );
}

/// The battery; not-a-number is not measured.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct BatteryState {
    pub header: Header,
    pub voltage: f32,
    pub temperature: f32,
    pub current: f32,
    pub charge: f32,
    pub capacity: f32,
    pub design_capacity: f32,
    pub percentage: f32,
    pub power_supply_status: u8,
    pub power_supply_health: u8,
    pub power_supply_technology: u8,
    pub present: bool,
    pub cell_voltage: Vec<f32>,
    pub cell_temperature: Vec<f32>,
    pub location: String,
    pub serial_number: String,
}

impl Message for BatteryState {
    const NAME: &'static str = "sensor_msgs/msg/BatteryState";
    const DEFINITION: &'static str = definition!(
        "std_msgs/Header header\nfloat32 voltage\nfloat32 temperature\nfloat32 current\nfloat32 charge\nfloat32 capacity\n\
         float32 design_capacity\nfloat32 percentage\nuint8 power_supply_status\nuint8 power_supply_health\n\
         uint8 power_supply_technology\nbool present\nfloat32[] cell_voltage\nfloat32[] cell_temperature\n\
         string location\nstring serial_number",
        "std_msgs/Header": header!(), "builtin_interfaces/Time": time!()
    );
}

/// One name with its value.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct KeyValue {
    pub key: String,
    pub value: String,
}

/// The state of one part.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct DiagnosticStatus {
    pub level: u8,
    pub name: String,
    pub message: String,
    pub hardware_id: String,
    pub values: Vec<KeyValue>,
}

/// Faults and the link's counters.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct DiagnosticArray {
    pub header: Header,
    pub status: Vec<DiagnosticStatus>,
}

impl Message for DiagnosticArray {
    const NAME: &'static str = "diagnostic_msgs/msg/DiagnosticArray";
    const DEFINITION: &'static str = definition!(
        "std_msgs/Header header\ndiagnostic_msgs/DiagnosticStatus[] status",
        "std_msgs/Header": header!(), "builtin_interfaces/Time": time!(),
        "diagnostic_msgs/DiagnosticStatus": "byte OK=0\nbyte WARN=1\nbyte ERROR=2\nbyte STALE=3\nbyte level\nstring name\n\
         string message\nstring hardware_id\ndiagnostic_msgs/KeyValue[] values",
        "diagnostic_msgs/KeyValue": "string key\nstring value"
    );
}

/// What a map's cells mean.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct MapMetaData {
    pub map_load_time: Time,
    pub resolution: f32,
    pub width: u32,
    pub height: u32,
    pub origin: Pose,
}

/// The map: 0 to 100 % occupied, −1 unknown.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct OccupancyGrid {
    pub header: Header,
    pub info: MapMetaData,
    pub data: Vec<i8>,
}

impl Message for OccupancyGrid {
    const NAME: &'static str = "nav_msgs/msg/OccupancyGrid";
    const DEFINITION: &'static str = definition!(
        "std_msgs/Header header\nnav_msgs/MapMetaData info\nint8[] data",
        "std_msgs/Header": header!(), "builtin_interfaces/Time": time!(),
        "nav_msgs/MapMetaData": "builtin_interfaces/Time map_load_time\nfloat32 resolution\nuint32 width\nuint32 height\n\
         geometry_msgs/Pose origin",
        "geometry_msgs/Pose": pose!(), "geometry_msgs/Point": xyz!(), "geometry_msgs/Quaternion": quaternion!()
    );
}
