//! The ROS 2 messages of recordings and of the node, with their definitions as MCAP carries them (encoding
//! `ros2msg`).
#![allow(missing_docs, reason = "the fields are those of ROS 2's definitions")]

mod conversions;

use serde::{Deserialize, Serialize};

/// A type of a field.
pub trait Type {
    /// As definitions write it: `float64`, `geometry_msgs/Point[]`.
    fn name() -> String;

    /// Adds name and definition of it and of the types it contains to those found already.
    fn define(_found: &mut Vec<(String, String)>) {}
}

/// A message.
pub trait Message: Type + Serialize {
    /// `package/msg/Type`.
    const NAME: &'static str;

    /// Its definition, followed by those of the types it contains.
    fn definition() -> String {
        let mut found = Vec::new();
        Self::define(&mut found);
        let rule = "=".repeat(80);
        let sections = found.into_iter().enumerate().map(|(nth, (name, fields))| {
            if nth == 0 {
                return fields;
            }
            format!("\n{rule}\nMSG: {name}\n{fields}")
        });
        sections.collect()
    }
}

macro_rules! primitives {
    ($($rust:ty = $ros:literal),+) => {$(
        impl Type for $rust {
            fn name() -> String {
                $ros.into()
            }
        }
    )+};
}

primitives! {
    bool = "bool", u8 = "uint8", Byte = "byte", i8 = "int8", i32 = "int32", u32 = "uint32", f32 = "float32",
    f64 = "float64", [f64; 9] = "float64[9]", [[f64; 6]; 6] = "float64[36]", String = "string"
}

impl<T: Type> Type for Vec<T> {
    fn name() -> String {
        T::name() + "[]"
    }

    fn define(found: &mut Vec<(String, String)>) {
        T::define(found);
    }
}

/// Declares messages by the names of ROS 2, the constants of their definitions, and their fields.
macro_rules! messages {
    ($($(#[$attribute:meta])* $name:ident = $ros:literal $(+ $constants:literal)* {
        $($field:ident: $type:ty),+ $(,)?
    })+) => {$(
        $(#[$attribute])*
        #[derive(Clone, Debug, Default, Serialize, Deserialize)]
        pub struct $name {
            $(pub $field: $type,)+
        }

        impl Type for $name {
            fn name() -> String {
                $ros.replace("/msg/", "/")
            }

            fn define(found: &mut Vec<(String, String)>) {
                if found.iter().any(|(known, _)| *known == Self::name()) {
                    return;
                }
                let fields = [$(<$type>::name() + " " + stringify!($field)),+].join("\n");
                found.push((Self::name(), concat!($($constants, "\n"),*).to_owned() + &fields));
                $(<$type>::define(found);)+
            }
        }

        impl Message for $name {
            const NAME: &'static str = $ros;
        }
    )+};
}

/// Frames of the rangefinders: front, right, left.
pub const RANGE_FRAMES: [&str; 3] = ["range_front", "range_right", "range_left"];

/// A number whose values have names.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Byte(pub u8);

messages! {
    /// Seconds and nanoseconds.
    #[derive(Copy, PartialEq, Eq)]
    Time = "builtin_interfaces/msg/Time" { sec: i32, nanosec: u32 }

    /// When, and in which frame.
    Header = "std_msgs/msg/Header" { stamp: Time, frame_id: String }

    #[derive(Copy)]
    Point = "geometry_msgs/msg/Point" { x: f64, y: f64, z: f64 }

    #[derive(Copy)]
    Vector3 = "geometry_msgs/msg/Vector3" { x: f64, y: f64, z: f64 }

    /// A rotation.
    #[derive(Copy)]
    Quaternion = "geometry_msgs/msg/Quaternion" { x: f64, y: f64, z: f64, w: f64 }

    /// Position, metres, and orientation.
    #[derive(Copy)]
    Pose = "geometry_msgs/msg/Pose" { position: Point, orientation: Quaternion }

    /// The reported pose.
    PoseStamped = "geometry_msgs/msg/PoseStamped" { header: Header, pose: Pose }

    /// Any text.
    Text = "std_msgs/msg/String" { data: String }

    /// Where the robot is, and how fast. Covariances of zeros are unknown.
    Odometry = "nav_msgs/msg/Odometry" {
        header: Header, child_frame_id: String, pose: PoseWithCovariance,
        twist: TwistWithCovariance,
    }

    /// A pose of [`Odometry`].
    #[derive(Copy)]
    PoseWithCovariance = "geometry_msgs/msg/PoseWithCovariance" {
        pose: Pose, covariance: [[f64; 6]; 6],
    }

    /// A velocity of [`Odometry`].
    #[derive(Copy)]
    TwistWithCovariance = "geometry_msgs/msg/TwistWithCovariance" {
        twist: Twist, covariance: [[f64; 6]; 6],
    }

    /// Velocity, m/s, and angular velocity, rad/s.
    #[derive(Copy)]
    Twist = "geometry_msgs/msg/Twist" { linear: Vector3, angular: Vector3 }

    /// Whether something is so.
    #[derive(Copy)]
    Bool = "std_msgs/msg/Bool" { data: bool }

    /// One rangefinder, metres; infinite without an echo (REP 117).
    #[allow(clippy::struct_field_names, reason = "the names of ROS 2")]
    Range = "sensor_msgs/msg/Range" + "uint8 ULTRASOUND=0" + "uint8 INFRARED=1" {
        header: Header, radiation_type: u8, field_of_view: f32, min_range: f32, max_range: f32,
        range: f32,
    }

    /// Translation, metres, and rotation.
    #[derive(Copy)]
    Transform = "geometry_msgs/msg/Transform" { translation: Vector3, rotation: Quaternion }

    /// From a frame to a child.
    TransformStamped = "geometry_msgs/msg/TransformStamped" {
        header: Header, child_frame_id: String, transform: Transform,
    }

    /// The frames.
    TfMessage = "tf2_msgs/msg/TFMessage" { transforms: Vec<TransformStamped> }

    /// The gyroscope's angle as an orientation; covariances whose first is −1 mark what is not known.
    Imu = "sensor_msgs/msg/Imu" {
        header: Header, orientation: Quaternion, orientation_covariance: [f64; 9],
        angular_velocity: Vector3, angular_velocity_covariance: [f64; 9],
        linear_acceleration: Vector3, linear_acceleration_covariance: [f64; 9],
    }

    /// The battery; not-a-number is not measured.
    BatteryState = "sensor_msgs/msg/BatteryState" {
        header: Header, voltage: f32, temperature: f32, current: f32, charge: f32, capacity: f32,
        design_capacity: f32, percentage: f32, power_supply_status: u8, power_supply_health: u8,
        power_supply_technology: u8, present: bool, cell_voltage: Vec<f32>,
        cell_temperature: Vec<f32>, location: String, serial_number: String,
    }

    /// One name with its value.
    KeyValue = "diagnostic_msgs/msg/KeyValue" { key: String, value: String }

    /// The state of one part.
    DiagnosticStatus = "diagnostic_msgs/msg/DiagnosticStatus"
        + "byte OK=0" + "byte WARN=1" + "byte ERROR=2" + "byte STALE=3" {
        level: Byte, name: String, message: String, hardware_id: String, values: Vec<KeyValue>,
    }

    /// Faults and the link's counters.
    DiagnosticArray = "diagnostic_msgs/msg/DiagnosticArray" {
        header: Header, status: Vec<DiagnosticStatus>,
    }

    /// What a map's cells mean.
    MapMetaData = "nav_msgs/msg/MapMetaData" {
        map_load_time: Time, resolution: f32, width: u32, height: u32, origin: Pose,
    }

    /// The map: 0 to 100 % occupied, −1 unknown.
    OccupancyGrid = "nav_msgs/msg/OccupancyGrid" {
        header: Header, info: MapMetaData, data: Vec<i8>,
    }
}
