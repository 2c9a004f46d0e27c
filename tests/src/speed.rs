//! How fast frames may come, for how long, and what a torn one costs.

use std::error::Error;

use plant::{Pose2, Room};
use twin::components::spi_master::pack;
use twin::trace::{Event, What};
use twin::{Options, Step};

use crate::reference::{image_in_mode, normal_frame, NormalReply, KEY_STM};
use crate::test_board::{Rig, TIM5_CCR1};

/// The tick's period, nanoseconds.
pub const TICK_NS: u64 = 10_000_000;
/// From the chip-select's fall to the first clock, and from the last to its rise, nanoseconds.
pub const SETUP_NS: u64 = 1_000;
/// Shortest pause between two frames, nanoseconds.
pub const GAP_NS: u64 = 20_000;
/// Bytes of a Normal frame.
pub const NORMAL: u64 = 19;
/// Cells of the battery here: replies walk through them, so an odd and large number shows one that
/// came twice and one that never came.
const CELLS: u8 = 7;

/// What a long run at a high rate showed.
#[derive(Clone, Copy, Debug)]
pub struct Endurance {
    /// Frames sent.
    pub frames: u64,
    /// Frames rejected or overrun, and replies that were repeated, left out or not whole.
    pub lost: u64,
    /// Replies that carried the data of a tick before the last but one.
    pub stale: u64,
    /// Ticks that passed meanwhile.
    pub ticks: u64,
    /// The oldest data of a reply at the fall of its chip-select, microseconds since their tick.
    pub oldest_us: f64,
    /// Worst distance of two ticks from the period, microseconds: without a frame, and under them.
    pub jitter_us: (f64, f64),
}

/// A robot in a corridor so long that it can drive straight on for the whole run.
fn in_a_corridor(elf: &[u8]) -> Result<Rig, Box<dyn Error>> {
    let mut image = image_in_mode(0);
    image[0x0203] = CELLS;
    let divider: Vec<u8> = image[0x0210..0x0218].to_vec();
    for cell in 2..usize::from(CELLS) {
        image[0x0210 + 8 * cell..][..8].copy_from_slice(&divider);
    }
    let start = Pose2 {
        x_mm: 0.0,
        y_mm: 0.0,
        heading_rad: 0.0,
    };
    let rig = Rig::with_elf(
        elf,
        Options {
            eeprom: Some(image),
            room: Room::default()
                .with_wall(-1e3, 1e3, 1e5, 1e3)
                .with_wall(-1e3, -1e3, 1e5, -1e3),
            start: Some(start),
            ..Options::default()
        },
    );
    if rig.await_ready() {
        Ok(rig)
    } else {
        Err(format!("no READY: {}", rig.log()).into())
    }
}

/// Frames at a fixed period.
#[must_use]
pub fn burst(frame: &[u8], hz: u64, period: u64, count: u64) -> Vec<Step> {
    let bits = Step::bytes(frame, hz);
    let rest = period.saturating_sub(2 * SETUP_NS + bits.duration());
    (0..count)
        .flat_map(|_| {
            [
                Step::Select(true),
                Step::Wait(SETUP_NS),
                bits.clone(),
                Step::Wait(SETUP_NS),
                Step::Select(false),
                Step::Wait(rest),
            ]
        })
        .collect()
}

/// When the ticks were, and when the chip-select fell.
fn times(events: &[Event]) -> (Vec<u64>, Vec<u64>) {
    let at = |wanted: fn(&What) -> bool| {
        let found = events.iter().filter(move |event| wanted(&event.what));
        found.map(|event| event.at_ns).collect()
    };
    (
        at(|what| {
            matches!(
                what,
                What::Wrote {
                    address: TIM5_CCR1,
                    ..
                }
            )
        }),
        at(|what| *what == What::Select(true)),
    )
}

/// The worst distance of two neighbours from the tick's period, microseconds.
fn jitter_us(ticks: &[u64]) -> f64 {
    let worst = ticks
        .windows(2)
        .map(|pair| (pair[1] - pair[0]).abs_diff(TICK_NS))
        .max();
    #[allow(clippy::cast_precision_loss)] // nanoseconds far below 2⁵²
    let worst = worst.unwrap_or(TICK_NS) as f64;
    worst / 1000.0
}

/// `rate` Normal frames a second at a clock of `hz` for `seconds` virtual seconds, driving straight on
/// meanwhile so that every tick's data is new.
///
/// # Errors
/// Where the robot does not start or does not drive.
pub fn endurance(
    elf: &[u8],
    hz: u64,
    rate: u64,
    seconds: u64,
) -> Result<Endurance, Box<dyn Error>> {
    let rig = in_a_corridor(elf)?;
    rig.board.follow_writes(TIM5_CCR1);
    rig.board.run_us(2_000_000);
    let (ticks, _) = times(&rig.board.take_events());
    let quiet = jitter_us(&ticks);

    let frame = normal_frame(20_000_000, 0, 0, true);
    let _ = rig.keep_sending(&frame, 1_500_000);
    let _ = rig.board.take_events();
    rig.board.follow_select();
    let mut replies = Vec::new();
    let mut behind_us: f64 = 0.0;
    // A little more than a tenth of a second each: all phases of the tick come to be looked at.
    for _ in 0..10 * seconds {
        let bits = rig
            .board
            .spi_raw(burst(&frame, hz, 1_000_000_000 / rate, rate / 10 + 7))?;
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
    let (ticks, falls) = times(&rig.board.take_events());
    // A tick, and some for the odometry's error.
    if falls.len() != replies.len() || behind_us > 12_500.0 {
        return Err(format!("{} frames, {behind_us} µs behind", falls.len()).into());
    }
    let mut seen = Endurance {
        frames: replies.len() as u64,
        lost: 0,
        stale: 0,
        ticks: ticks.len() as u64,
        oldest_us: 0.0,
        jitter_us: (quiet, jitter_us(&ticks)),
    };
    follow(&replies, &falls, &ticks, &mut seen);
    rig.board.run_us(2_100_000);
    seen.lost += dropped(&rig.log());
    Ok(seen)
}

/// Goes through the replies. The robot drives, so every tick has a pose of its own and a pose that a
/// reply shows for the first time is that of the last tick before it: this is what [`endurance`] checks
/// against the truth ten times a second.
fn follow(replies: &[NormalReply], falls: &[u64], ticks: &[u64], seen: &mut Endurance) {
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

/// Frames that the log says were rejected or overrun.
fn dropped(log: &str) -> u64 {
    let mut dropped = 0;
    for line in log.lines() {
        let text = line.split_once(": ").map_or("", |(_, text)| text);
        let number = || text.split(' ').next().and_then(|word| word.parse().ok());
        if text.starts_with("frame rejected: ") {
            dropped += 1;
        } else if text.ends_with("more frames rejected") || text.ends_with("were lost") {
            dropped += number().unwrap_or(0);
        }
    }
    dropped
}

/// Torn frames and what they took with them.
#[derive(Clone, Copy, Debug)]
pub struct Tears {
    /// Frames torn: one after every number of bits that is not the whole frame.
    pub torn: u64,
    /// Frames lost, the torn ones included.
    pub lost: u64,
}

/// Tears a Normal frame after every bit, frames before and behind it at `rate` a second.
///
/// # Errors
/// Where the robot does not start.
pub fn tears(elf: &[u8], hz: u64, rate: u64) -> Result<Tears, Box<dyn Error>> {
    let rig = in_a_corridor(elf)?;
    rig.board.run_us(100_000);
    let frame = normal_frame(0, 0, 0, false);
    let mut seen = Tears { torn: 0, lost: 0 };
    let mut before = None;
    for bits in 0..8 * frame.len() {
        let Step::Bits { mut mosi, .. } = Step::bytes(&frame, hz) else {
            return Err("bytes are bits".into());
        };
        mosi.truncate(bits);
        let period = 1_000_000_000 / rate;
        let taken = 2 * SETUP_NS + bits as u64 * 1_000_000_000 / hz;
        let mut steps = vec![
            Step::Select(true),
            Step::Wait(SETUP_NS),
            Step::Bits { mosi, hz },
            Step::Wait(SETUP_NS),
            Step::Select(false),
            Step::Wait(period.saturating_sub(taken).max(GAP_NS)),
        ];
        steps.extend(burst(&frame, hz, period, 2));
        let back = rig.board.spi_raw(steps)?;
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
    Ok(seen)
}
