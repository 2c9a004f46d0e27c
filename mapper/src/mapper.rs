//! From reports to the map.

use crate::range_filter::{Filter, Gate, Reading, Verdict};
use crate::{Cone, Grid, Mount, Pose};

/// How a map is made.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// Width of the map's cells, mm.
    pub cell_mm: f64,
    /// The rangefinders, in the order their ranges are given in.
    pub mounts: Vec<Mount>,
    /// The sensors' cone and the weights of the evidence.
    pub cone: Cone,
    /// Nearest and farthest range believed, mm.
    pub limits_mm: (f64, f64),
    /// Difference at rest that two successive readings of one surface may have, mm.
    pub gate_mm: f64,
}

impl Default for Config {
    /// The first board; cells of 25 mm. The wire carries ranges below 2500 mm.
    fn default() -> Self {
        Self {
            cell_mm: 25.0,
            mounts: Mount::first_board().to_vec(),
            cone: Cone::default(),
            limits_mm: (30.0, 2490.0),
            gate_mm: 40.0,
        }
    }
}

/// What became of the readings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Echoes entered into the map.
    pub echoes: u64,
    /// Believed silences entered into the map.
    pub silences: u64,
    /// Readings that stood alone and were dropped.
    pub alone: u64,
    /// Repeats of a measurement, and readings outside the limits.
    pub ignored: u64,
}

/// The filters and the grid.
#[derive(Clone, Debug)]
pub struct Mapper {
    config: Config,
    filters: Vec<Filter>,
    /// Bearing and range of the last swept reading.
    swept: Option<(f64, Option<f64>)>,
    grid: Grid,
    counters: Counters,
}

impl Mapper {
    /// An empty map.
    #[must_use]
    pub fn new(config: Config) -> Self {
        let gate = Gate {
            still_mm: config.gate_mm,
            limits_mm: config.limits_mm,
        };
        Self {
            filters: vec![Filter::new(gate); config.mounts.len()],
            swept: None,
            grid: Grid::new(config.cell_mm),
            config,
            counters: Counters::default(),
        }
    }

    /// Takes one report: the believed pose and the latest range of every rangefinder in the order
    /// of [`Config::mounts`], mm, `None` = no echo or out of range. Give every report once, repeats
    /// of a measurement included; further ranges than mounts are not looked at.
    pub fn observe(&mut self, pose: &Pose, ranges_mm: &[Option<f64>]) {
        for (index, range_mm) in ranges_mm.iter().enumerate() {
            if let Some(mount) = self.config.mounts.get(index) {
                let reading = Reading {
                    sensor: mount.on(pose),
                    range_mm: *range_mm,
                };
                let verdict = self.filters[index].take(reading);
                self.settle(verdict);
            }
        }
    }

    /// Takes one reading of a swept rangefinder that looked along `bearing_rad` when it measured;
    /// otherwise like [`Mapper::observe`]. A repeat of the last bearing with the last range is the same
    /// measurement: no two in turn share a bearing.
    pub fn observe_swept(
        &mut self,
        pose: &Pose,
        sensor: usize,
        bearing_rad: f64,
        range_mm: Option<f64>,
    ) {
        if let Some(mount) = self.config.mounts.get(sensor) {
            let mount = Mount {
                bearing_rad,
                ..*mount
            };
            let again =
                self.swept.replace((bearing_rad, range_mm)) == Some((bearing_rad, range_mm));
            let verdict = if again {
                Verdict::Ignored
            } else {
                self.filters[sensor].take_new(Reading {
                    sensor: mount.on(pose),
                    range_mm,
                })
            };
            self.settle(verdict);
        }
    }

    fn settle(&mut self, verdict: Verdict) {
        match verdict {
            Verdict::Waiting => {}
            Verdict::Ignored => self.counters.ignored += 1,
            Verdict::Alone => self.counters.alone += 1,
            Verdict::Believed(Reading {
                sensor,
                range_mm: Some(range),
            }) => {
                self.counters.echoes += 1;
                self.config.cone.echo(&mut self.grid, &sensor, range);
            }
            Verdict::Believed(Reading {
                sensor,
                range_mm: None,
            }) => {
                self.counters.silences += 1;
                self.config.cone.silence(&mut self.grid, &sensor);
            }
        }
    }

    /// The map so far.
    #[must_use]
    pub const fn grid(&self) -> &Grid {
        &self.grid
    }

    /// What became of the readings so far.
    #[must_use]
    pub const fn counters(&self) -> Counters {
        self.counters
    }
}
