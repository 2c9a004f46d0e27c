//! The map from reported poses and ranges.

use crate::range_filter::{Gate, RangeFilter, Reading, Verdict};
use crate::{Grid, Mount, Pose2, SonarModel};

/// How a map is made.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// Width of the map's cells, mm.
    pub cell_mm: f64,
    /// The rangefinders: front, right, left; `None` where none is fitted.
    pub mounts: [Option<Mount>; 3],
    /// The sensors' beam and the weights of the evidence.
    pub sonar: SonarModel,
    /// Nearest and farthest range accepted, mm.
    pub limits_mm: (f64, f64),
    /// Difference at rest that two successive readings of one surface may have, mm.
    pub gate_mm: f64,
}

impl Default for Config {
    /// The first board; cells of 25 mm. The wire carries ranges below 2500 mm.
    fn default() -> Self {
        Self {
            cell_mm: 25.0,
            mounts: Mount::first_board().map(Some),
            sonar: SonarModel::default(),
            limits_mm: (30.0, 2490.0),
            gate_mm: 40.0,
        }
    }
}

/// Number of readings by outcome.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Echoes entered into the map.
    pub echoes: u64,
    /// Silences entered into the map.
    pub silences: u64,
    /// Isolated readings, dropped.
    pub outliers: u64,
    /// Repeats of a measurement, and readings outside the limits.
    pub ignored: u64,
}

/// The filters and the grid.
#[derive(Clone, Debug)]
pub struct Mapper {
    config: Config,
    filters: [RangeFilter; 3],
    /// Bearing and range of the last scanned reading.
    scanned: Option<(f64, Option<f64>)>,
    grid: Grid,
    counters: Counters,
}

impl Mapper {
    /// An empty map.
    pub fn new(config: Config) -> Self {
        let gate = Gate {
            still_mm: config.gate_mm,
            limits_mm: config.limits_mm,
        };
        Self {
            filters: [(); 3].map(|()| RangeFilter::new(gate)),
            scanned: None,
            grid: Grid::new(config.cell_mm),
            config,
            counters: Counters::default(),
        }
    }

    /// Takes one report: the estimated pose and the latest range of every rangefinder in the order
    /// of [`Config::mounts`], mm, `None` = no echo or out of range. Give every report once, repeats
    /// of a measurement included; ranges without a mount are ignored.
    // Requirement: DOC-1-2
    pub fn observe(&mut self, pose: &Pose2, ranges_mm: &[Option<f64>]) {
        for (sensor, range_mm) in ranges_mm.iter().enumerate() {
            self.observe_fixed(pose, sensor, *range_mm);
        }
    }

    /// Takes the latest range of one rangefinder along its mount, otherwise like
    /// [`Mapper::observe`].
    pub fn observe_fixed(&mut self, pose: &Pose2, sensor: usize, range_mm: Option<f64>) {
        if let Some(Some(mount)) = self.config.mounts.get(sensor) {
            let reading = Reading {
                sensor: mount.sensor_pose(pose),
                range_mm,
            };
            let verdict = self.filters[sensor].take(reading);
            self.enter(verdict);
        }
    }

    /// Takes one reading of a rangefinder on a servo, measured along `bearing_rad`; otherwise like
    /// [`Mapper::observe`]. A repeat of the last bearing and range is the same measurement:
    /// successive measurements differ in their bearing.
    pub fn observe_scan(
        &mut self,
        pose: &Pose2,
        sensor: usize,
        bearing_rad: f64,
        range_mm: Option<f64>,
    ) {
        if let Some(Some(mount)) = self.config.mounts.get(sensor) {
            let mount = Mount::new(mount.ahead_mm, mount.left_mm, bearing_rad);
            let reading = Reading {
                sensor: mount.sensor_pose(pose),
                range_mm,
            };
            let scan = Some((bearing_rad, range_mm));
            let again = std::mem::replace(&mut self.scanned, scan) == scan;
            let verdict = if again {
                Verdict::Ignored
            } else {
                self.filters[sensor].take_new(reading)
            };
            self.enter(verdict);
        }
    }

    fn enter(&mut self, verdict: Verdict) {
        match verdict {
            Verdict::Pending => {}
            Verdict::Ignored => self.counters.ignored += 1,
            Verdict::Outlier => self.counters.outliers += 1,
            Verdict::Accepted(Reading { sensor, range_mm }) => {
                let (sonar, grid) = (&self.config.sonar, &mut self.grid);
                if let Some(range) = range_mm {
                    self.counters.echoes += 1;
                    sonar.enter_echo(grid, &sensor, range);
                } else {
                    self.counters.silences += 1;
                    sonar.enter_silence(grid, &sensor);
                }
            }
        }
    }

    /// The map so far.
    pub const fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Number of readings by outcome so far.
    pub const fn counters(&self) -> Counters {
        self.counters
    }
}
