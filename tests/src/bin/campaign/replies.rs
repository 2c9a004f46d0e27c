//! No reply lies: what the Pi accepts is what the sensors had delivered at the tick whose data it holds, even where they
//! lie themselves: the counts that the firmware read, the pulses on the echo lines, the battery's voltages.

use fw_core::eeprom::Config;
use fw_core::motion::Odometry;
use fw_core::types::Faults;
use fw_core::wire::{CellCode, DistanceCode, PoseCode, Report};
use plant::Pose2;
use twin::Board;
use twin::board_model::Ping;

/// The encoders' counters (RM0383, table 1 and 13.4), and the register that boot starts the left one with.
const TIM2_CR1: u64 = 0x4000_0000;
const TIM2_CNT: u64 = 0x4000_0024;
const TIM3_CNT: u64 = 0x4000_0424;
/// The longest tick's work, 81 µs, a frame and its gap.
const NEAREST_NS: u64 = 130_000;
/// Without an echo of its own a sensor is known to have none at the second tick after its trigger. Its next trigger
/// comes 60 to 90 ms later, a tick more where it must wait. Microseconds.
const SILENT_US: f64 = 21e3;
const NEXT_US: f64 = 78e3;
const OLDEST_US: f64 = 130e3;
/// From the trigger to the pulse, 250 µs, and from its end to the tick, and half the way of sound at 20 °C, mm/µs.
const RISE_US: f64 = 380.0;
const SOUND: f64 = 0.34342 / 2.0;
/// The filter has taken in a step of the voltages after so many milliseconds.
const FILTERED_MS: usize = 2_000;

/// What the sensors have delivered since boot.
pub struct Replies {
    config: Config,
    odometry: Option<Odometry>,
    left: u32,
    /// When, ns, and the pose by the counts alone.
    ticks: Vec<(u64, PoseCode)>,
    /// Of the last accepted report, and its tick.
    before: Option<(Report, usize)>,
    /// A lie unless a slip explains it, which the status may tell a reply later.
    unless_slip: Option<String>,
    /// Each millisecond.
    cells_v: Vec<[f64; 2]>,
    /// The converter does not see them.
    pub cells_unread: bool,
    pub lines_crossed: bool,
    /// The ticks' timer, which times the echoes too, stops.
    pub clock_stops: bool,
}

fn moved(from: PoseCode, to: PoseCode) -> Pose2 {
    let [from, to] = [from, to].map(|code| {
        let [x, y] = [code.x, code.y].map(|um| f64::from(um) / 1_000.0);
        Pose2::new(
            x,
            y,
            f64::from(code.rotation) / 32_768.0 * std::f64::consts::TAU,
        )
    });
    to.relative_to(&from)
}

impl Replies {
    pub fn new(board: &Board, config: Config) -> Self {
        board.trace_memory(&[TIM2_CR1, TIM2_CNT, TIM3_CNT], 0..0);
        Self {
            config,
            odometry: None,
            left: 0,
            ticks: Vec::new(),
            before: None,
            unless_slip: None,
            cells_v: Vec::new(),
            cells_unread: false,
            lines_crossed: false,
            clock_stops: false,
        }
    }

    /// The voltages at the converter's pins, each millisecond.
    pub fn look(&mut self, pins_v: [f64; 2]) {
        let dividers = self.config.dividers();
        let ratio =
            |nth: usize| f64::from(dividers[nth].upper.0) / f64::from(dividers[nth].lower.0);
        let [one, both] = [0, 1].map(|nth| pins_v[nth] * (1.0 + ratio(nth)));
        self.cells_v.push([one, (both - one).max(0.0)]);
    }

    #[expect(clippy::cast_possible_truncation, reason = "32 and 16 bits")]
    fn read_counts(&mut self, board: &Board) {
        for access in board.take_snapshots() {
            match access.register {
                TIM2_CR1 => {
                    self.ticks.clear();
                    (self.odometry, self.before, self.unless_slip) = (None, None, None);
                }
                TIM2_CNT => self.left = access.value as u32,
                _ => {
                    let (left, right) = (self.left, access.value as u16);
                    let first = || Odometry::new(&self.config, left, right);
                    let odometry = self.odometry.get_or_insert_with(first);
                    odometry.step(left, right);
                    let pose = PoseCode::from_pose(&odometry.pose());
                    self.ticks.push((access.at_ns, pose));
                }
            }
        }
    }

    /// What the reply of a frame that has just ended lies about, and how.
    pub fn lies(&mut self, board: &Board, report: &Report) -> Vec<(&'static str, String)> {
        self.read_counts(board);
        let now = board.now_ns();
        let is_due = |(at, _): &(u64, _)| now - at >= NEAREST_NS;
        let Some(due) = self.ticks.iter().rposition(is_due) else {
            return Vec::new();
        };
        let mut lies = Vec::new();
        let slips = |report: &Report| report.faults.intersects(Faults::SLIP);
        let earlier = self.unless_slip.take().filter(|_| !slips(report));
        lies.extend(earlier.map(|lie| ("a reply lies about the pose", lie)));
        let (before, base) = self.before.unwrap_or_default();
        let mut ticks = (due..self.ticks.len()).take(2);
        let shown = moved(before.pose, report.pose);
        let follows = |tick: &usize| {
            let counted = moved(self.ticks[base].1, self.ticks[*tick].1);
            let off = (shown.x_mm - counted.x_mm).hypot(shown.y_mm - counted.y_mm);
            let turn = (shown.heading_rad - counted.heading_rad).sin();
            // Codes of 1 µm and of 0.2 mrad.
            turn.abs() < 5e-4 && off < 0.003 + 2e-4 * shown.x_mm.hypot(shown.y_mm)
        };
        let tick = ticks.find(follows);
        if tick.is_none() && !slips(&before) && !slips(report) {
            let counted = self.ticks[due].1;
            self.unless_slip = Some(format!("{:?}, counted {counted:?}", report.pose));
        }
        self.before = Some((*report, tick.unwrap_or(due)));
        let (pings, shown) = (board.pings(), report.ranges.map(DistanceCode::to_distance));
        let shown = shown.map(|range| range.map(|range| range.0.to_num()));
        if !(0..3).all(|sensor| self.has_measured(sensor, shown[sensor], due, &pings)) {
            lies.push(("a reply lies about a distance", format!("{shown:?} mm")));
        }
        let CellCode { cell, voltage } = report.cell;
        let shown = f64::from(voltage) / 200.0;
        let latest = || self.cells_v.iter().rev().take(FILTERED_MS);
        let off = || latest().map(|cells| cells[usize::from(cell)] - shown);
        let is_between = off().any(|off| off < 0.05) && off().any(|off| off > -0.05);
        if due >= 3 && !self.cells_unread && !is_between {
            lies.push(("a reply lies about a cell", format!("{:?}", report.cell)));
        }
        lies
    }

    /// Whether a sensor's last echo, or a newer one than the tick's, is this distance.
    fn has_measured(&self, sensor: usize, shown: Option<f64>, due: usize, pings: &[Ping]) -> bool {
        let (boot, data) = (self.ticks[0].0, self.ticks[due].0);
        for ping in pings.iter().rev().take_while(|ping| ping.at_ns > boot) {
            if ping.sensor != sensor {
                continue;
            }
            let mm = ping.echo_us.map(|us| us * SOUND);
            let mm = mm.filter(|mm| *mm < 2_520.0);
            // Of crossed lines the pulse is another's.
            let known = ping.echo_us.filter(|_| !self.lines_crossed);
            let age_us = u32::try_from(data.saturating_sub(ping.at_ns) / 1_000);
            let age_us = age_us.map_or(f64::MAX, f64::from);
            let is_known = age_us > known.unwrap_or(SILENT_US).min(SILENT_US) + RISE_US;
            let is_this = match (shown, mm) {
                (Some(shown), Some(mm)) if self.clock_stops && !is_known && shown < mm => true,
                (Some(shown), Some(mm)) => (shown - mm).abs() < 1.0 + mm / 200.0,
                (None, Some(mm)) => self.lines_crossed || !(25.0..2_480.0).contains(&mm),
                (shown, None) => shown.is_none(),
            };
            if is_this && age_us < OLDEST_US {
                return true;
            }
            if is_known {
                return shown.is_none() && age_us > NEXT_US;
            }
        }
        shown.is_none()
    }
}
