//! What reports hold for the mapper, and the files of maps.

use fw_core::eeprom::Config;
use fw_core::types::RangefinderId;
use fw_core::wire::Field;
use host_link::error::Error;
use host_link::file::{self, Kind};
use host_link::pose::Pose;
use host_link::snapshot::Snapshot;
use mapper::{Grid, Mount, Pose2, map_plot, ros};
use std::path::{Path, PathBuf};

/// One report as the mapper takes it.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct RangeSample {
    /// Microseconds on the machine's clock.
    pub time_us: u64,
    /// The reported pose.
    pub pose: Pose,
    /// Front, right, left; in the sweep mode the first is the swept one. Millimetres.
    pub ranges_mm: [Option<f64>; 3],
    /// Where the front sensor sweeps: the bearing of the first, degrees.
    pub bearing_deg: Option<f64>,
    /// Guarded Velocity: the gyro's own angle, degrees.
    pub gyro_deg: Option<f64>,
    /// See [`Snapshot::silent`].
    #[serde(skip)]
    pub silent: [bool; 3],
}

impl RangeSample {
    /// What a snapshot holds for the mapper; none in a mode without poses.
    pub fn of(snapshot: &Snapshot) -> Option<Self> {
        snapshot.pose.map(|pose| Self {
            time_us: snapshot.time_us,
            pose,
            ranges_mm: snapshot.ranges_mm,
            bearing_deg: snapshot.bearing_deg,
            gyro_deg: snapshot.gyro_turns.map(|turns| turns * 360.0),
            silent: snapshot.silent,
        })
    }
}

/// The files of a map.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Files {
    /// The picture with the trace.
    pub png: PathBuf,
    /// The picture for ROS.
    pub pgm: PathBuf,
    /// The text that goes with it.
    pub yaml: PathBuf,
}

impl Files {
    /// `stem`.png, `stem`.pgm and `stem`.yaml.
    pub fn new(stem: &Path) -> Self {
        Self {
            png: file::with_suffix(stem, ".png"),
            pgm: file::with_suffix(stem, ".pgm"),
            yaml: file::with_suffix(stem, ".yaml"),
        }
    }

    /// Whether all of them can be written, before the wheels turn.
    ///
    /// # Errors
    /// [`Error::Unwritable`].
    pub fn check(stem: &Path) -> Result<(), Error> {
        let files = Self::new(stem);
        file::check(&files.png, Kind::Png)?;
        file::check(&files.pgm, Kind::Pgm)?;
        file::check(&files.yaml, Kind::MapYaml)
    }
}

/// Writes a map: `stem`.png under the path, `stem`.pgm and `stem`.yaml as ROS map servers read them.
///
/// # Errors
/// [`Error::Unwritable`].
pub fn save_map(grid: &Grid, path: &[Pose2], stem: &Path) -> Result<Files, Error> {
    let files = Files::new(stem);
    let png = map_plot::trajectory(grid, path, &[], &[]);
    let png = png.map_err(|cause| Error::unwritable(&files.png, &cause))?;
    file::save(&files.png, Kind::Png, &png)?;
    file::save(&files.pgm, Kind::Pgm, &ros::pgm(grid))?;
    let picture = files.pgm.file_name().unwrap_or_default().to_string_lossy();
    file::save(
        &files.yaml,
        Kind::MapYaml,
        ros::yaml(grid, &picture).as_bytes(),
    )?;
    Ok(files)
}

/// # Errors
/// [`Error::Content`] for poses of `path` that a map of cells of `cell_mm` does not hold.
pub fn check_extent(
    poses: impl IntoIterator<Item = Pose>,
    cell_mm: f64,
    path: &Path,
) -> Result<(), Error> {
    let farther_mm = |far: f64, pose: Pose| far.max(pose.x_mm.abs()).max(pose.y_mm.abs());
    let far_m = poses.into_iter().fold(0.0, farther_mm) / 1000.0;
    let most_m = f64::from(map_plot::MAX_SIDE_CELLS / 2 - 100) * cell_mm / 1000.0;
    if far_m <= most_m {
        return Ok(());
    }
    let accepted = format!("with cells of {cell_mm} mm (--cell) accepted are {most_m:.0} m");
    let what = format!("it goes {far_m:.0} m from the start; {accepted}");
    Err(Error::content(path, None, what))
}

/// Reads a map that [`save_map`] or a ROS map server wrote, by its YAML file.
///
/// # Errors
/// [`Error::Unreadable`], [`Error::Content`].
pub fn load_map(path: &Path) -> Result<Grid, Error> {
    let text = file::read_text(path)?;
    let wrong = |what| Error::content(path, None, what);
    let picture = path.with_file_name(ros::value(&text, "image").map_err(wrong)?);
    // A byte a cell, after the head.
    let max = u64::from(map_plot::MAX_SIDE_CELLS).pow(2) + file::MAX_TEXT;
    let pixels = file::read(&picture, max)?;
    ros::read(&text, &pixels).map_err(wrong)
}

/// The pose as the mapper takes it.
pub fn mapper_pose(pose: Pose) -> Pose2 {
    Pose2::new(pose.x_mm, pose.y_mm, pose.rotation_deg.to_radians())
}

/// The mapper's pose as the STM reports one.
pub fn reported_pose(pose: &Pose2) -> Pose {
    Pose::new(pose.x_mm, pose.y_mm, pose.heading_rad.to_degrees())
}

/// The origin of the reported poses in the map, where a reported pose is estimated to be this one.
pub fn odom_in_map(estimate: &Pose2, reported: &Pose2) -> Pose {
    let start = Pose2::default().relative_to(reported);
    reported_pose(&estimate.compose(&start))
}

/// Radius of the first board's body around the middle of the axle, mm: an assumption.
pub const BODY_MM: f64 = 100.0;
/// The rangefinders that are fitted and that the mode's frames carry, of front, right, left, on a body of this
/// radius, mm. The code of another is that of a beam without an echo.
// Requirement: WIRE-platform-5
pub fn mounts(config: &Config, body_mm: f64) -> [Option<Mount>; 3] {
    let carried = [Field::Front, Field::Right, Field::Left].map(|field| config.mode().has(field));
    let mut fitted = RangefinderId::ALL
        .into_iter()
        .take(config.rangefinders().into())
        .take_while(|&rangefinder| carried[rangefinder as usize]);
    let overhang_mm = config.obstacle_stop().overhang_mm.into();
    Mount::on_body(body_mm, overhang_mm).map(|mount| {
        let bearing = config.bearing(fitted.next()?).0.cast_signed();
        Some(Mount {
            bearing_rad: f64::from(bearing) / 4_294_967_296.0 * std::f64::consts::TAU,
            ..mount
        })
    })
}

/// Where they are on the robot, and look.
pub fn sensor_poses(config: &Config, body_mm: f64) -> [Option<Pose>; 3] {
    let pose = |mount: Mount| reported_pose(&mount.sensor_pose(&Pose2::default()));
    mounts(config, body_mm).map(|mount| mount.map(pose))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exploring::Localisation;
    use fw_core::eeprom::{Image, fields};
    use mapper::Point;

    // Requirement: DOC-2.2-2, WIRE-platform-4, WIRE-platform-5
    #[test]
    fn mounts_are_those_of_fitted_rangefinders() {
        let image = Image::FIRST_BOARD;
        let degrees = |image: &Image| {
            let mounts = mounts(&Config::decode(image).unwrap(), BODY_MM);
            let degrees = |mount: &Mount| mount.bearing_rad.to_degrees().round();
            mounts.iter().flatten().map(degrees).collect::<Vec<_>>()
        };
        // Front, right, left.
        assert_eq!(degrees(&image), [0.0, -90.0, 90.0]);
        let image = image
            .with(fields::BEARING_FRONT, 0x1000)
            .with(fields::BEARING_RIGHT, 0xE000)
            .with(fields::RANGEFINDERS, 2);
        assert_eq!(degrees(&image), [23.0, -45.0]);
        // Its frames carry the front one alone.
        let sweep = fw_core::wire::Mode::GuardedSweep.code().into();
        let image = image.with(fields::MODE, sweep).with(fields::SERVO, 1);
        assert_eq!(degrees(&image), [23.0]);
        let image = Image::FIRST_BOARD.with(fields::FRONT_OVERHANG, 30);
        let wide = mounts(&Config::decode(&image).unwrap(), 170.0).map(Option::unwrap);
        let places = wide.map(|mount| (mount.ahead_mm, mount.left_mm));
        assert_eq!(places, [(140.0, 0.0), (0.0, -130.0), (0.0, 130.0)]);
    }

    #[test]
    fn way_beyond_any_picture_is_refused() {
        let extent = |x, y| {
            check_extent(
                [Pose::default(), Pose::new(x, y, 0.0)],
                25.0,
                Path::new("way"),
            )
        };
        assert_eq!(extent(47_000.0, -47_000.0), Ok(()));
        for (x, y) in [(48_000.0, 0.0), (0.0, -48_000.0)] {
            let refused = extent(x, y).unwrap_err().to_string();
            assert!(refused.contains("48 m from the start"), "{refused}");
        }
    }

    #[test]
    fn swept_range_is_mapped_by_its_bearing_beside_fixed_ones() {
        let config = Config::decode(&Image::FIRST_BOARD).unwrap();
        let mut localisation = Localisation::new(&config, BODY_MM, 25.0);
        // Along two walls, at y = 1000 mm and y = −760 mm.
        for step in 0..100_u32 {
            let range_mm = |mm| Some(f64::from(mm + step % 2));
            localisation.observe(&RangeSample {
                time_us: u64::from(step) * 25_000,
                pose: Pose::new(10.0 * f64::from(step), 0.0, 0.0),
                ranges_mm: [range_mm(1000), range_mm(700), None],
                bearing_deg: Some(90.0),
                ..RangeSample::default()
            });
        }
        for map in [&localisation.localiser, &localisation.raw] {
            let occupied = map.grid().occupied().map(|at| at.y_mm);
            let (left, right): (Vec<f64>, Vec<f64>) = occupied.partition(|y_mm| *y_mm > 0.0);
            assert!(
                left.len() > 10 && left.iter().all(|y_mm| (y_mm - 1000.0).abs() < 50.0),
                "{left:?}"
            );
            assert!(
                right.len() > 10 && right.iter().all(|y_mm| (y_mm + 760.0).abs() < 50.0),
                "{right:?}"
            );
        }
    }

    #[test]
    fn map_files_are_checked_written_and_read_back() {
        let folder = tempfile::tempdir().unwrap();
        let stem = folder.path().join("map");
        assert_eq!(Files::check(&stem), Ok(()));
        let files = Files::new(&stem);
        for file in [files.png, files.pgm, files.yaml] {
            std::fs::write(&file, "foreign\n").unwrap();
            assert!(Files::check(&stem).is_err(), "{}", file.display());
            std::fs::remove_file(file).unwrap();
        }
        let (low, high) = (Point::default(), Point::new(500.0, 300.0));
        let grid = Grid::from_fn(25.0, low, high, |_| -3.0);
        let files = save_map(&grid, &[], &stem).unwrap();
        let read = load_map(&files.yaml).unwrap();
        assert_eq!((read.columns(), read.rows()), (grid.columns(), grid.rows()));
    }
}
