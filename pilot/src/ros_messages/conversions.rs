//! The messages of what the robot reports. Times are microseconds since the receiver's epoch.

use super::{
    BatteryState, Byte, DiagnosticArray, DiagnosticStatus, Header, KeyValue, MapMetaData,
    OccupancyGrid, Point, Pose, Quaternion, Range, Time, Transform, TransformStamped, Vector3,
};
use host_link::pose;
use host_link::snapshot::Snapshot;
use mapper::{Cell, Grid};

impl Time {
    /// Of microseconds.
    pub fn of(us: u64) -> Self {
        Self {
            sec: i32::try_from(us / 1_000_000).unwrap_or(i32::MAX),
            nanosec: u32::try_from(us % 1_000_000 * 1000).unwrap_or_default(),
        }
    }
}

impl Header {
    /// At a time, in a frame.
    pub fn of(us: u64, frame: &str) -> Self {
        Self {
            stamp: Time::of(us),
            frame_id: frame.into(),
        }
    }
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

impl From<pose::Pose> for Pose {
    fn from(pose: pose::Pose) -> Self {
        Self {
            position: Point {
                x: pose.x_mm / 1000.0,
                y: pose.y_mm / 1000.0,
                z: 0.0,
            },
            orientation: Quaternion::of_degrees(pose.rotation_deg),
        }
    }
}

impl TransformStamped {
    /// The pose of the frame `child` in the frame `parent`.
    pub fn of(us: u64, parent: &str, child: &str, pose: pose::Pose) -> Self {
        let Pose {
            position: Point { x, y, z },
            orientation: rotation,
        } = pose.into();
        Self {
            header: Header::of(us, parent),
            child_frame_id: child.into(),
            transform: Transform {
                translation: Vector3 { x, y, z },
                rotation,
            },
        }
    }
}

impl Range {
    /// A rangefinder's distance, none without an echo.
    pub fn of(us: u64, frame: &str, mm: Option<f64>) -> Self {
        #[allow(clippy::cast_possible_truncation)] // metres
        let range = mm.map_or(f32::INFINITY, |mm| (mm / 1000.0) as f32);
        Self {
            header: Header::of(us, frame),
            radiation_type: 0,
            field_of_view: 0.26,
            min_range: 0.02,
            max_range: 2.5,
            range,
        }
    }
}

impl BatteryState {
    /// The cells' voltages.
    pub fn of(us: u64, snapshot: &Snapshot) -> Self {
        #[allow(clippy::cast_possible_truncation)]
        let volts = |cell: &Option<f64>| cell.map_or(f32::NAN, |volts| volts as f32);
        let cells: Vec<f32> = snapshot.cells_v.iter().map(volts).collect();
        let none = f32::NAN;
        Self {
            header: Header::of(us, "base_link"),
            voltage: cells.iter().sum(),
            temperature: none,
            current: none,
            charge: none,
            capacity: none,
            design_capacity: none,
            percentage: none,
            // Lithium polymer.
            power_supply_technology: 3,
            present: true,
            cell_voltage: cells,
            ..Self::default()
        }
    }
}

impl DiagnosticArray {
    /// The faults, or else the state, and the link's counters.
    pub fn of(us: u64, snapshot: &Snapshot) -> Self {
        let value = |key: &str, value: String| KeyValue {
            key: key.into(),
            value,
        };
        let link = &snapshot.link;
        let faults = snapshot.faults.join(", ");
        let status = DiagnosticStatus {
            level: Byte(if faults.is_empty() { 0 } else { 2 }),
            name: "robot".into(),
            message: if faults.is_empty() {
                snapshot.state.unwrap_or("").to_string()
            } else {
                faults
            },
            hardware_id: "stm32f411".into(),
            values: vec![
                value("mode", snapshot.mode.to_string()),
                value("frames", link.frames.to_string()),
                value("rejected", link.rejected.to_string()),
                value("worst_gap_us", link.worst_gap_us.to_string()),
            ],
        };
        Self {
            header: Header::of(us, ""),
            status: vec![status],
        }
    }
}

impl OccupancyGrid {
    /// A map in the frame `map`.
    pub fn of(us: u64, grid: &Grid) -> Self {
        let origin = grid.origin();
        #[allow(clippy::cast_possible_truncation)] // some thousand cells of some millimetres
        let info = MapMetaData {
            map_load_time: Time::of(us),
            resolution: (grid.cell_mm() / 1000.0) as f32,
            width: u32::try_from(grid.columns()).unwrap_or(u32::MAX),
            height: u32::try_from(grid.rows()).unwrap_or(u32::MAX),
            origin: pose::Pose::new(origin.x_mm, origin.y_mm, 0.0).into(),
        };
        let cells = grid.cells();
        let cells = cells.map(|(column, row)| match grid.cell(column, row) {
            Cell::Occupied => 100,
            Cell::Free => 0,
            Cell::Unknown => -1,
        });
        Self {
            header: Header::of(us, "map"),
            info,
            data: cells.collect(),
        }
    }
}

#[test]
fn battery_faults_and_map_are_converted() {
    use fw_core::eeprom::{Config, Image};
    let mut robot = Snapshot::new(&Config::decode(&Image::FIRST_BOARD).unwrap());
    (robot.cells_v, robot.faults) = (vec![Some(3.5), Some(4.0)], vec!["left-stalled"]);
    assert!((BatteryState::of(0, &robot).voltage - 7.5).abs() < 1e-6);
    let status = &DiagnosticArray::of(0, &robot).status[0];
    assert_eq!((status.level.0, &*status.message), (2, "left-stalled"));
    let corners = [(-1000.0, 0.0), (1000.0, 500.0)].map(|(x, y)| mapper::Point::new(x, y));
    let grid = Grid::from_fn(25.0, corners[0], corners[1], |_| -4.0);
    let OccupancyGrid { header, info, .. } = OccupancyGrid::of(2_345_678, &grid);
    assert!(info.width > info.height && info.width as usize == grid.columns());
    let (at, cell, origin) = (info.origin.position, info.resolution, grid.origin());
    assert!((cell - 0.025).abs() < 1e-6 && (at.x - origin.x_mm / 1e3).abs() < 1e-6);
    assert!((at.y - origin.y_mm / 1e3).abs() < 1e-6);
    assert_eq!((header.stamp.sec, header.stamp.nanosec), (2, 345_678_000));
}
