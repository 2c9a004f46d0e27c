//! No reply lies: what the Pi accepts is what the sensors had delivered at the tick whose data it holds, even where they
//! lie themselves: the counts that the firmware read, the pulses on the echo lines, the battery's voltages.

use fw_core::eeprom::{Config, Divider};
use fw_core::motion::Odometry;
use fw_core::types::Faults;
use fw_core::wire::{PoseCode, Report};
use plant::Pose2;
use twin::Board;
use twin::board_model::Ping;

/// The encoders' counters (RM0383, table 1 and 13.4), and the register that boot starts the left one with.
const TIM2_CR1: u64 = 0x4000_0000;
const TIM2_CNT: u64 = 0x4000_0024;
const TIM3_CNT: u64 = 0x4000_0424;
const MS: u64 = 1_000_000;
/// The longest tick's work, 81 µs, a frame and its gap.
const NEAREST_NS: u64 = 130_000;
/// Without an echo of its own a sensor is known to have none at the second tick after its trigger. Its next trigger
/// comes 60 to 90 ms later, a tick more where it must wait.
const SILENT_NS: u64 = 21 * MS;
const NEXT_NS: u64 = 78 * MS;
const OLDEST_NS: u64 = 130 * MS;
/// From the trigger to the pulse and from its end to the tick, ns, and half the way of sound at 20 °C, mm/µs.
const RISE_NS: u64 = 250_000 + NEAREST_NS;
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
    /// Each millisecond, at the converter's pins.
    pub pins_v: Vec<[f64; 2]>,
    /// The converter does not see them.
    pub cells_unread: bool,
    pub lines_crossed: bool,
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

/// The voltage of a tap from that of its pin.
fn tap((volts, divider): (&f64, &Divider)) -> f64 {
    volts * (1.0 + f64::from(divider.upper.0) / f64::from(divider.lower.0))
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
            pins_v: Vec::new(),
            cells_unread: false,
            lines_crossed: false,
        }
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
        let told = moved(before.pose, report.pose);
        let follows = |tick: &usize| {
            let counted = moved(self.ticks[base].1, self.ticks[*tick].1);
            let off = (told.x_mm - counted.x_mm).hypot(told.y_mm - counted.y_mm);
            let turn = (told.heading_rad - counted.heading_rad).sin();
            // Codes of 1 µm and of 0.2 mrad.
            turn.abs() < 5e-4 && off < 0.003 + 2e-4 * told.x_mm.hypot(told.y_mm)
        };
        let tick = ticks.find(follows);
        if tick.is_none() && !slips(&before) && !slips(report) {
            let counted = self.ticks[due].1;
            self.unless_slip = Some(format!("{:?}, counted {counted:?}", report.pose));
        }
        self.before = Some((*report, tick.unwrap_or(due)));
        let pings = board.pings();
        for (sensor, code) in report.ranges.iter().enumerate() {
            let told = code.to_distance().map(|distance| distance.0.to_num());
            if !self.has_measured(sensor, told, due, &pings) {
                lies.push((
                    "a reply lies about a distance",
                    format!("{sensor}: {told:?} mm"),
                ));
            }
        }
        let nth = usize::from(report.cell.cell);
        let told = f64::from(report.cell.voltage) / 200.0;
        let taps = |pins: &[f64; 2]| pins.iter().zip(self.config.dividers()).map(tap).collect();
        let cell = |taps: Vec<f64>| {
            (taps[nth] - nth.checked_sub(1).map_or(0.0, |below| taps[below])).max(0.0)
        };
        let cells = self
            .pins_v
            .iter()
            .rev()
            .take(FILTERED_MS)
            .map(taps)
            .map(cell);
        let [low, high] = cells.fold([f64::MAX, 0.0], |[low, high], volts| {
            [volts.min(low), volts.max(high)]
        });
        if due >= 3 && !self.cells_unread && !(low - 0.05..=high + 0.05).contains(&told) {
            lies.push(("a reply lies about a cell", format!("{:?}", report.cell)));
        }
        lies
    }

    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "µs"
    )]
    /// Whether a sensor's last echo, or a newer one than the tick's, is this distance.
    fn has_measured(&self, sensor: usize, told: Option<f64>, due: usize, pings: &[Ping]) -> bool {
        let (boot, data) = (self.ticks[0].0, self.ticks[due].0);
        for ping in pings.iter().rev().take_while(|ping| ping.at_ns > boot) {
            if ping.sensor != sensor {
                continue;
            }
            let mm = ping.echo_us.map(|us| us * SOUND);
            let mm = mm.filter(|mm| *mm < 2_520.0);
            let is_this = match (told, mm) {
                (Some(told), Some(mm)) => (told - mm).abs() < 1.0 + mm / 200.0,
                (None, Some(mm)) => self.lines_crossed || !(25.0..2_480.0).contains(&mm),
                (told, None) => told.is_none(),
            };
            let age = data.saturating_sub(ping.at_ns);
            if is_this && age < OLDEST_NS {
                return true;
            }
            // Of crossed lines the pulse is another's.
            let us = ping.echo_us.filter(|_| !self.lines_crossed);
            if age > us.map_or(SILENT_NS, |us| (us * 1e3) as u64).min(SILENT_NS) + RISE_NS {
                return told.is_none() && age > NEXT_NS;
            }
        }
        told.is_none()
    }
}
