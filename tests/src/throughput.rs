//! The link's throughput: sustained frame rates, a long run, and what a torn frame costs.

use std::error::Error;

use plant::{Pose2, Room};
use twin::components::spi_master::pack;
use twin::trace::{Event, EventKind};
use twin::{Options, SpiStep};

use crate::reference::{KEY_STM, NormalReply, image_in_mode, normal_frame};
use crate::test_board::{Rig, TIM5_CCR1};
use crate::wires::{first_bits, selected};

/// The tick's period, nanoseconds.
pub const TICK_NS: u64 = 10_000_000;
/// From the fall of chip-select to the first clock, and from the last to its rise, nanoseconds.
const SETUP_NS: u64 = 1_000;
/// Shortest pause between two frames, nanoseconds.
pub const GAP_NS: u64 = 20_000;
/// Bytes of a Normal frame.
const NORMAL: u64 = 19;
/// Frame rates tried by [`sustained`], frames a second.
const RATES: [u64; 9] = [
    2_000, 5_000, 8_000, 10_000, 12_000, 16_000, 20_000, 24_000, 28_000,
];
/// Cells of the battery: replies take them in turn, so a large odd number shows a repeated and a missing
/// reply.
const CELLS: u8 = 7;

/// Result of [`long_run`].
#[derive(Clone, Copy, Debug)]
pub struct LongRun {
    /// Frames sent.
    pub frames: u64,
    /// Frames rejected or overrun, and replies that were repeated, left out or not whole.
    pub lost: u64,
    /// Replies with data older than the last tick but one.
    pub stale: u64,
    /// The oldest data of a reply at the fall of its chip-select, microseconds since their tick.
    pub oldest_us: f64,
    /// Worst distance of two ticks from the period, microseconds.
    pub jitter_us: f64,
    /// The same before the first frame.
    pub jitter_without_frames_us: f64,
}

/// A robot in a corridor long enough to drive straight on for the whole run.
fn in_a_corridor(elf: &[u8]) -> Rig {
    let mut image = image_in_mode(0);
    image[0x0203] = CELLS;
    let divider: Vec<u8> = image[0x0210..0x0218].to_vec();
    for cell in 2..usize::from(CELLS) {
        image[0x0210 + 8 * cell..][..8].copy_from_slice(&divider);
    }
    let corridor = Room::default()
        .with_wall(-1e3, 1e3, 1e5, 1e3)
        .with_wall(-1e3, -1e3, 1e5, -1e3);
    let options = Options::with_eeprom(image).in_room(corridor);
    let rig = Rig::with_elf(elf, options.at(Pose2::default()));
    rig.assert_ready();
    rig
}

/// The shortest period of Normal frames at a clock of `hz`, nanoseconds.
pub fn shortest_period(hz: u64) -> u64 {
    2 * SETUP_NS + NORMAL * 8_000_000_000 / hz + GAP_NS
}

/// Frames at a fixed period.
fn burst(frame: &[u8], hz: u64, period: u64, count: u64) -> Vec<SpiStep> {
    let bits = SpiStep::bytes(frame, hz);
    let rest = period.saturating_sub(2 * SETUP_NS + bits.duration());
    let one = [&selected(SETUP_NS, bits)[..], &[SpiStep::Wait(rest)]].concat();
    (0..count).flat_map(|_| one.clone()).collect()
}

/// The times of the events that `wanted` selects, nanoseconds.
fn times(events: &[Event], wanted: fn(&EventKind) -> bool) -> Vec<u64> {
    let found = events.iter().filter(|event| wanted(&event.kind));
    found.map(|event| event.at_ns).collect()
}

fn is_tick(kind: &EventKind) -> bool {
    matches!(kind, EventKind::Write { address, .. } if *address == TIM5_CCR1)
}

/// The worst distance of two neighbours from the tick's period, microseconds.
fn worst_jitter_us(ticks: &[u64]) -> f64 {
    let worst = ticks
        .windows(2)
        .map(|pair| (pair[1] - pair[0]).abs_diff(TICK_NS))
        .max();
    #[allow(clippy::cast_precision_loss)] // nanoseconds far below 2⁵²
    let worst = worst.unwrap_or(TICK_NS) as f64;
    worst / 1000.0
}

/// The worst distance of two ticks from their period under back-to-back frames at 8 MHz, microseconds.
pub fn jitter_us(rig: &Rig) -> f64 {
    rig.board.trace_writes(TIM5_CCR1);
    let period = shortest_period(8_000_000);
    let frame = normal_frame(500_000, 0, 0, true);
    for _ in 0..20 {
        let steps = burst(&frame, 8_000_000, period, 50_000_000 / period);
        rig.board.spi_steps(steps);
    }
    worst_jitter_us(&times(&rig.board.take_events(), is_tick))
}

/// The highest frame rate at a clock of `hz` at which `lossless(hz, rate)` holds.
///
/// # Errors
/// Where `lossless` fails.
pub fn sustained(
    hz: u64,
    lossless: impl Fn(u64, u64) -> Result<bool, Box<dyn Error>>,
) -> Result<u64, Box<dyn Error>> {
    let mut best = 0;
    for rate in RATES {
        if 1_000_000_000 / rate < shortest_period(hz) || !lossless(hz, rate)? {
            break;
        }
        best = rate;
    }
    Ok(best)
}

/// Whether a second of frames passes without one lost, rejected, repeated or torn, driving meanwhile.
pub fn lossless(rig: &Rig, hz: u64, rate: u64) -> bool {
    let frame = normal_frame(500_000, 0, 0, true);
    let mut last = None;
    for _ in 0..10 {
        let steps = burst(&frame, hz, 1_000_000_000 / rate, rate / 10);
        for bytes in pack(&rig.board.spi_steps(steps)).chunks(frame.len()) {
            let reply = NormalReply::of(bytes);
            // The cells take turns: the same one again is an old reply.
            let fresh = last.replace(reply.cell) != Some(reply.cell);
            if reply.key != KEY_STM || reply.not_used || reply.cell > 1 || !fresh {
                return false;
            }
        }
    }
    rig.board.run_us(50_000);
    let log = rig.log();
    !log.contains("rejected") && !log.contains("lost") && !rig.motors_off()
}

/// `rate` Normal frames a second at a clock of `hz` for `seconds` virtual seconds, driving straight on
/// meanwhile so that every tick's data is new.
///
/// # Errors
/// Where the robot does not drive.
pub fn long_run(elf: &[u8], hz: u64, rate: u64, seconds: u64) -> Result<LongRun, Box<dyn Error>> {
    let rig = in_a_corridor(elf);
    rig.board.trace_writes(TIM5_CCR1);
    rig.board.run_us(2_000_000);
    let quiet = worst_jitter_us(&times(&rig.board.take_events(), is_tick));

    let frame = normal_frame(20_000_000, 0, 0, true);
    let _ = rig.keep_sending(&frame, 1_500_000);
    let _ = rig.board.take_events();
    rig.board.trace_chip_select();
    let mut replies = Vec::new();
    let mut behind_us: f64 = 0.0;
    // A little more than a tenth of a second each: all phases of the tick come to be looked at.
    for _ in 0..10 * seconds {
        let bits = rig
            .board
            .spi_steps(burst(&frame, hz, 1_000_000_000 / rate, rate / 10 + 7));
        replies.extend(pack(&bits).chunks(frame.len()).map(NormalReply::of));
        // How far the robot has come since the pose it reported last is how old that is.
        let truth = rig.board.truth();
        let speed = (truth.wheel_deg_s.left + truth.wheel_deg_s.right) / 720.0
            * std::f64::consts::PI
            * 80.0;
        if speed < 50.0 {
            return Err(format!("the robot does not drive: {truth:?}").into());
        }
        let reported = replies
            .last()
            .map_or(0.0, |reply| f64::from(reply.x) / 1000.0);
        behind_us = behind_us.max((truth.pose.x_mm - reported) / speed * 1e6);
    }
    let events = rig.board.take_events();
    let ticks = times(&events, is_tick);
    let falls = times(&events, |what| *what == EventKind::ChipSelect(true));
    // A tick, two frames, and some for the odometry's error.
    #[allow(clippy::cast_precision_loss)] // frames a second, far below 2⁵²
    let limit_us = 12_300.0 + 2e6 / rate as f64;
    if falls.len() != replies.len() || behind_us > limit_us {
        return Err(format!("{} frames, {behind_us} µs behind", falls.len()).into());
    }
    let mut seen = LongRun {
        frames: replies.len() as u64,
        lost: 0,
        stale: 0,
        oldest_us: 0.0,
        jitter_us: worst_jitter_us(&ticks),
        jitter_without_frames_us: quiet,
    };
    follow(&replies, &falls, &ticks, &mut seen);
    rig.board.run_us(2_100_000);
    seen.lost += dropped(&rig.log());
    Ok(seen)
}

/// Goes through the replies. The robot drives, so every tick has a pose of its own and a pose that a
/// reply shows for the first time is that of the last tick before it: this is what [`long_run`] checks
/// against the truth ten times a second.
fn follow(replies: &[NormalReply], falls: &[u64], ticks: &[u64], seen: &mut LongRun) {
    let mut before: Option<&NormalReply> = None;
    // Of the pose shown: the number of its tick.
    let mut of_tick = None;
    for (reply, &fall) in replies.iter().zip(falls) {
        let last = ticks.partition_point(|&tick| tick <= fall).checked_sub(1);
        let whole = reply.key == KEY_STM && !reply.not_used && reply.cell < CELLS;
        let next = before.is_none_or(|before| reply.cell == (before.cell + 1) % CELLS);
        seen.lost += u64::from(!whole || !next);
        if before.is_some_and(|before| reply.x != before.x) {
            of_tick = last;
        }
        if let (Some(of_tick), Some(last)) = (of_tick, last) {
            seen.stale += u64::from(last - of_tick > 1);
            #[allow(clippy::cast_precision_loss)] // nanoseconds far below 2⁵²
            let age = (fall - ticks[of_tick]) as f64 / 1000.0;
            seen.oldest_us = seen.oldest_us.max(age);
        }
        before = Some(reply);
    }
}

/// The log's counts: frames rejected, and frames lost because they came too fast.
#[must_use]
pub fn logged_counts(log: &str) -> (usize, usize) {
    let mut counts = (0, 0);
    for line in log.lines() {
        let text = line.split_once(": ").map_or("", |(_, text)| text);
        let number = || text.split(' ').next().and_then(|word| word.parse().ok());
        if text.starts_with("frame rejected: ") {
            counts.0 += 1;
        } else if text.ends_with(" more frames rejected") {
            counts.0 += number().unwrap_or(0);
        } else if text.ends_with(" frames lost: not read in time") {
            counts.1 += number().unwrap_or(0);
        }
    }
    counts
}

fn dropped(log: &str) -> u64 {
    let (rejected, lost) = logged_counts(log);
    (rejected + lost) as u64
}

/// Result of [`torn_frames`].
#[derive(Clone, Copy, Debug)]
pub struct TornFrames {
    /// Frames torn: one after every number of bits that is not the whole frame.
    pub torn: u64,
    /// Frames lost, the torn ones included.
    pub lost: u64,
}

/// Tears a Normal frame after every bit, frames before and behind it at `rate` a second.
pub fn torn_frames(elf: &[u8], hz: u64, rate: u64) -> TornFrames {
    let rig = in_a_corridor(elf);
    rig.board.run_us(100_000);
    let frame = normal_frame(0, 0, 0, false);
    let mut seen = TornFrames { torn: 0, lost: 0 };
    let mut before = None;
    for bits in 0..8 * frame.len() {
        let period = 1_000_000_000 / rate;
        let torn = first_bits(&frame, hz, bits);
        let taken = 2 * SETUP_NS + torn.duration();
        let mut steps = selected(SETUP_NS, torn).to_vec();
        steps.push(SpiStep::Wait(period.saturating_sub(taken).max(GAP_NS)));
        steps.extend(burst(&frame, hz, period, 2));
        let back = rig.board.spi_steps(steps);
        seen.torn += 1;
        // The torn frame carried a reply as well.
        let mut turns = 2;
        for reply in pack(&back[bits..]).chunks(frame.len()).map(NormalReply::of) {
            let whole = reply.key == KEY_STM && !reply.not_used && (reply.x, reply.y) == (0, 0);
            let next = before.is_none_or(|cell| reply.cell == (cell + turns) % CELLS);
            seen.lost += u64::from(!whole || !next);
            before = Some(reply.cell);
            turns = 1;
        }
    }
    rig.board.run_us(2_100_000);
    seen.lost += dropped(&rig.log());
    seen
}
