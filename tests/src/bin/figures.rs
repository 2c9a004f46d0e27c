//! The figures of the release ELF, measured on the emulated core: `target/figures.json` and a table.
//!
//! `figures --elf PATH --hand PATH [--out FILE]`, where the second ELF is the first with feature
//! `test-hand`; exit code 1 where a bar is missed, 2 on a wrong argument. How each
//! figure is measured is in docs/figures.md.
#![forbid(unsafe_code)]

use std::cell::Cell;
use std::error::Error;
use std::path::PathBuf;
use std::{env, fs};

use object::{Object, ObjectSection, ObjectSegment, SectionKind};
use robot_tests::reference::{crc16, image_in_mode, normal_frame, NormalReply, KEY_PI, KEY_STM};
use robot_tests::speed::{burst, endurance, tears, Endurance, GAP_NS, NORMAL, SETUP_NS, TICK_NS};
use robot_tests::stack::Stack;
use robot_tests::test_board::{Rig, READY_US, TIM5_CCR1};
use serde::Serialize;
use twin::trace::{shares, spans, without, Event, Span, What};
use twin::Options;

/// The control register of the stream that feeds SPI1 (RM0383, 9.5.5): bit 0 enables it.
const DMA2_S3CR: u64 = 0x4002_6458;
/// Rates tried for the sustained one, frames a second.
const RATES: [u64; 9] = [
    2_000, 5_000, 8_000, 10_000, 12_000, 16_000, 20_000, 24_000, 28_000,
];
/// The long run: clock, frames a second, virtual seconds.
// The rate is no multiple of the tick's, so the frames pass through all of its phases.
const LONG: (u64, u64, u64) = (12_000_000, 10_007, 10);
/// What the original C++ took to decode a Normal frame and encode its reply on this core at -O2.
const ORIGINAL: f64 = 4947.0;

#[derive(Clone, Copy, Serialize)]
struct Spread {
    min: u64,
    mean: f64,
    max: u64,
    samples: usize,
}

impl Spread {
    fn of(values: &[u64]) -> Option<Self> {
        #[allow(clippy::cast_precision_loss)] // counts far below 2⁵²
        let mean = values.iter().sum::<u64>() as f64 / values.len() as f64;
        Some(Self {
            min: *values.iter().min()?,
            mean,
            max: *values.iter().max()?,
            samples: values.len(),
        })
    }
}

#[derive(Serialize)]
struct Figures {
    flash_bytes: u64,
    static_ram_bytes: u64,
    boot_to_ready_us: u64,
    tick_instructions: Spread,
    odometry_step_instructions: Spread,
    frame_core_instructions: Spread,
    guarded_frame_core_instructions: Spread,
    frame_instructions: Spread,
    guarded_frame_instructions: Spread,
    hand_frame_instructions: Spread,
    codec_frame_instructions: Spread,
    frame_core_to_hand: f64,
    codec_to_hand: f64,
    original_to_frame_core: f64,
    tick_jitter_us: f64,
    frames_per_s_sustained: u64,
    frames_per_s_wire_limit: u64,
    frames_per_s_sustained_12_mhz: u64,
    frames_per_s_wire_limit_12_mhz: u64,
    sustained_to_wire_12_mhz: f64,
    long_run_frames_per_s: u64,
    long_run_frames: u64,
    long_run_lost: u64,
    long_run_stale: u64,
    long_run_oldest_us: f64,
    long_run_tick_jitter_us: f64,
    tick_jitter_without_frames_us: f64,
    frames_lost_per_tear: f64,
    stack_used_bytes: u64,
}

fn main() {
    let (mut elf, mut hand) = (None, None);
    let mut out = PathBuf::from("target/figures.json");
    let mut profile = false;
    let mut words = env::args().skip(1);
    while let Some(word) = words.next() {
        if word == "--profile" {
            profile = true;
            continue;
        }
        match (word.as_str(), words.next()) {
            ("--elf", Some(value)) => elf = Some(PathBuf::from(value)),
            ("--hand", Some(value)) => hand = Some(PathBuf::from(value)),
            ("--out", Some(value)) => out = PathBuf::from(value),
            _ => {
                eprintln!("figures: {word}. Usage: figures --elf PATH --hand PATH [--out FILE] [--profile]");
                std::process::exit(2);
            }
        }
    }
    let (Some(elf), Some(hand)) = (elf, hand) else {
        eprintln!("figures: --elf or --hand is missing. Usage: figures --elf PATH --hand PATH [--out FILE] [--profile]");
        std::process::exit(2);
    };
    if let Err(error) = run(&elf, &hand, &out, profile) {
        eprintln!("figures: {error}");
        std::process::exit(1);
    }
}

fn run(path: &PathBuf, hand: &PathBuf, out: &PathBuf, profile: bool) -> Result<(), Box<dyn Error>> {
    let elf = fs::read(path).map_err(|error| format!("{}: {error}", path.display()))?;
    let (flash_bytes, static_ram_bytes) = sizes(&elf)?;
    let bench = Bench {
        elf,
        stack_used: Cell::new(0),
    };
    if profile {
        bench.profile()?;
        return Ok(());
    }
    let (tick_instructions, odometry_step_instructions, frames) = bench.driving()?;
    let guarded = bench.guarded_frames()?;
    let (hand_frame_instructions, codec_frame_instructions) = by_hand(hand)?;
    let wire = |hz: u64| 1_000_000_000 / (2 * SETUP_NS + NORMAL * 8_000_000_000 / hz + GAP_NS);
    let (hz, rate, seconds) = LONG;
    let long: Endurance = endurance(&bench.elf, hz, rate, seconds)?;
    let torn = tears(&bench.elf, hz, rate)?;
    let sustained_12_mhz = bench.sustained(12_000_000)?;
    #[allow(clippy::cast_precision_loss)] // counts far below 2⁵²
    let figures = Figures {
        flash_bytes,
        static_ram_bytes,
        boot_to_ready_us: bench.boot_to_ready_us()?,
        tick_instructions,
        odometry_step_instructions,
        frame_core_instructions: frames.core,
        guarded_frame_core_instructions: guarded.core,
        frame_instructions: frames.whole,
        guarded_frame_instructions: guarded.whole,
        hand_frame_instructions,
        codec_frame_instructions,
        frame_core_to_hand: frames.core.mean / hand_frame_instructions.mean,
        codec_to_hand: codec_frame_instructions.mean / hand_frame_instructions.mean,
        original_to_frame_core: ORIGINAL / frames.core.mean,
        tick_jitter_us: bench.jitter_us()?,
        frames_per_s_sustained: bench.sustained(8_000_000)?,
        frames_per_s_wire_limit: wire(8_000_000),
        frames_per_s_sustained_12_mhz: sustained_12_mhz,
        frames_per_s_wire_limit_12_mhz: wire(12_000_000),
        sustained_to_wire_12_mhz: sustained_12_mhz as f64 / wire(12_000_000) as f64,
        long_run_frames_per_s: rate,
        long_run_frames: long.frames,
        long_run_lost: long.lost,
        long_run_stale: long.stale,
        long_run_oldest_us: long.oldest_us,
        long_run_tick_jitter_us: long.jitter_us.1,
        tick_jitter_without_frames_us: long.jitter_us.0,
        frames_lost_per_tear: torn.lost as f64 / torn.torn as f64,
        stack_used_bytes: bench.stack_used.get(),
    };
    if let Some(folder) = out.parent() {
        fs::create_dir_all(folder)?;
    }
    fs::write(out, serde_json::to_string_pretty(&figures)? + "\n")?;
    figures.print();
    Ok(())
}

impl Figures {
    /// The table. The bars are in `ci/budget.toml`.
    fn print(&self) {
        let spread =
            |s: &Spread| format!("{} / {:.0} / {} (n {})", s.min, s.mean, s.max, s.samples);
        let rows = [
            ("flash_bytes", self.flash_bytes.to_string()),
            ("static_ram_bytes", self.static_ram_bytes.to_string()),
            ("boot_to_ready_us", self.boot_to_ready_us.to_string()),
            ("tick_instructions", spread(&self.tick_instructions)),
            (
                "odometry_step_instructions",
                spread(&self.odometry_step_instructions),
            ),
            (
                "frame_core_instructions",
                spread(&self.frame_core_instructions),
            ),
            (
                "guarded_frame_core_instructions",
                spread(&self.guarded_frame_core_instructions),
            ),
            ("frame_instructions", spread(&self.frame_instructions)),
            (
                "guarded_frame_instructions",
                spread(&self.guarded_frame_instructions),
            ),
            ("  by hand", spread(&self.hand_frame_instructions)),
            (
                "  the strategies alone",
                spread(&self.codec_frame_instructions),
            ),
            (
                "  frame_core to by hand",
                format!("{:.2}", self.frame_core_to_hand),
            ),
            (
                "  the strategies to by hand",
                format!("{:.2}", self.codec_to_hand),
            ),
            (
                "  the original to frame_core",
                format!("{:.2}", self.original_to_frame_core),
            ),
            ("tick_jitter_us", format!("{:.2}", self.tick_jitter_us)),
        ];
        for (name, value) in rows.into_iter().chain(self.link_rows()) {
            println!("{name:36} {value:>34}");
        }
    }

    /// What the link sustains and what a tear costs.
    fn link_rows(&self) -> [(&'static str, String); 7] {
        let at_8 = (self.frames_per_s_sustained, self.frames_per_s_wire_limit);
        let at_12 = (
            self.frames_per_s_sustained_12_mhz,
            self.frames_per_s_wire_limit_12_mhz,
            self.sustained_to_wire_12_mhz,
        );
        let long = (
            self.long_run_frames,
            self.long_run_lost,
            self.long_run_stale,
        );
        let jitter = (
            self.long_run_tick_jitter_us,
            self.tick_jitter_without_frames_us,
        );
        [
            (
                "frames_per_s_sustained",
                format!("{} of the wire's {}", at_8.0, at_8.1),
            ),
            (
                "frames_per_s_sustained_12_mhz",
                format!("{} of the wire's {} ({:.2})", at_12.0, at_12.1, at_12.2),
            ),
            (
                "long run: frames, lost, stale",
                format!("{}, {}, {}", long.0, long.1, long.2),
            ),
            (
                "  oldest data, µs",
                format!("{:.0}", self.long_run_oldest_us),
            ),
            (
                "  tick jitter, without frames, µs",
                format!("{:.2}, {:.2}", jitter.0, jitter.1),
            ),
            (
                "frames_lost_per_tear",
                format!("{:.2}", self.frames_lost_per_tear),
            ),
            ("stack_used_bytes", self.stack_used_bytes.to_string()),
        ]
    }
}

/// What is flashed, and what is reserved in RAM but for the stack.
fn sizes(elf: &[u8]) -> Result<(u64, u64), Box<dyn Error>> {
    let file = object::File::parse(elf)?;
    let flash = file.segments().map(|segment| segment.file_range().1).sum();
    let ram = file
        .sections()
        .filter(|section| (0x2000_0000..0x4000_0000).contains(&section.address()))
        .filter(|section| {
            matches!(
                section.kind(),
                SectionKind::Data | SectionKind::UninitializedData
            )
        })
        .map(|section| section.size())
        .sum();
    Ok((flash, ram))
}

/// What frames take: in the core, and from the chip-select's rise until the reply is armed.
struct Frames {
    core: Spread,
    whole: Spread,
}

/// The Normal frame's handling by hand, and by the strategies and nothing else.
fn by_hand(path: &PathBuf) -> Result<(Spread, Spread), Box<dyn Error>> {
    let elf = fs::read(path).map_err(|error| format!("{}: {error}", path.display()))?;
    let rig = Rig::with_elf(
        &elf,
        Options {
            eeprom: Some(image_in_mode(0)),
            ..Options::default()
        },
    );
    if !rig.await_ready() {
        return Err(format!("no READY: {}", rig.log()).into());
    }
    let traced = [
        rig.board.trace("hand_frame")?,
        rig.board.trace("codec_frame")?,
    ];
    rig.board.run_us(200_000);
    let events = rig.board.take_events();
    let [hand, codec] = traced.map(|function| {
        let taken: Vec<u64> = spans(&function, &events)
            .iter()
            .map(|span| span.instructions)
            .collect();
        Spread::of(&taken).ok_or("never called")
    });
    Ok((hand?, codec?))
}

struct Bench {
    elf: Vec<u8>,
    /// The most of the stack that any of the runs has used, bytes.
    stack_used: Cell<u64>,
}

/// A board on the bench; its stack is looked at when it has run.
struct Run<'a> {
    rig: Rig,
    stack: Stack,
    used: &'a Cell<u64>,
}

impl std::ops::Deref for Run<'_> {
    type Target = Rig;

    fn deref(&self) -> &Rig {
        &self.rig
    }
}

impl Drop for Run<'_> {
    fn drop(&mut self) {
        // A run that has ended before its time has failed elsewhere.
        let used = self.stack.used(&self.rig.board).unwrap_or_default();
        self.used.set(self.used.get().max(used));
    }
}

impl Bench {
    fn rig(&self, mode: u8) -> Result<Run<'_>, Box<dyn Error>> {
        let rig = Rig::with_elf(
            &self.elf,
            Options {
                eeprom: Some(image_in_mode(mode)),
                ..Options::default()
            },
        );
        let stack = Stack::paint(&self.elf, &rig.board)?;
        if !rig.await_ready() {
            return Err(format!("no READY within {READY_US} µs: {}", rig.log()).into());
        }
        Ok(Run {
            rig,
            stack,
            used: &self.stack_used,
        })
    }

    fn boot_to_ready_us(&self) -> Result<u64, Box<dyn Error>> {
        let rig = self.rig(0)?;
        let ready = rig
            .board
            .outputs()
            .into_iter()
            .find(|change| change.pin == twin::pinout::READY && change.level)
            .ok_or("READY never rose")?;
        Ok(ready.at.div_ceil(1000))
    }

    /// Ticks and Normal frames while driving to a pose at 40 frames a second.
    fn driving(&self) -> Result<(Spread, Spread, Frames), Box<dyn Error>> {
        let rig = self.rig(0)?;
        let handler = rig.board.trace("TIM5")?;
        let tick = rig.board.trace("robot_tick")?;
        let odometry = rig.board.trace("Odometry::step")?;
        let frame = rig.board.trace("robot_frame")?;
        let edge = rig.board.trace("EXTI4")?;
        let echoes = ["EXTI0", "EXTI9_5", "EXTI15_10"]
            .map(|name| rig.board.trace(name))
            .into_iter()
            .collect::<Result<Vec<_>, _>>()?;
        rig.board.follow_select();
        rig.board.follow_writes(DMA2_S3CR);
        let _ = rig.keep_sending(&normal_frame(700_000, 400_000, 0x2000, true), 20_000_000);
        let events = rig.board.take_events();
        let (edges, latches) = (spans(&edge, &events), spans(&handler, &events));
        // The latch that belongs to a tick is the longest the handler takes.
        let latch = latches
            .iter()
            .map(|span| span.instructions)
            .max()
            .unwrap_or(0);
        let timed: Vec<Span> = echoes
            .iter()
            .flat_map(|echo| spans(echo, &events))
            .chain(latches)
            .collect();
        let preempting: Vec<Span> = timed.iter().copied().chain(edges).collect();
        let ticks: Vec<u64> = without(&spans(&tick, &events), &preempting)
            .iter()
            .map(|span| span.instructions + latch)
            .collect();
        // The chip-select's own handler belongs to the frame.
        let waited: Vec<Span> = spans(&tick, &events).into_iter().chain(timed).collect();
        let frames = Frames {
            core: core(&spans(&frame, &events), &preempting)?,
            whole: to_reply(&events, &spans(&frame, &events), &waited)?,
        };
        // And the call.
        let steps: Vec<u64> = without(&spans(&odometry, &events), &preempting)
            .iter()
            .map(|span| span.instructions + 1)
            .collect();
        Ok((
            Spread::of(&ticks).ok_or("no tick was seen")?,
            Spread::of(&steps).ok_or("no odometry step was seen")?,
            frames,
        ))
    }

    /// Where the tick's instructions go: its mean by function, over two seconds of the same drive.
    fn profile(&self) -> Result<(), Box<dyn Error>> {
        let rig = self.rig(0)?;
        let target = normal_frame(700_000, 400_000, 0x2000, true);
        let _ = rig.keep_sending(&target, 2_000_000);
        let tick = rig.board.trace("robot_tick")?;
        let code = rig.board.profile()?;
        let _ = rig.keep_sending(&target, 2_000_000);
        let events = rig.board.take_events();
        let ticks = spans(&tick, &events);
        println!("instructions of robot_tick, mean of {} ticks", ticks.len());
        for (name, count) in shares(&code, &ticks, &events) {
            #[allow(clippy::cast_precision_loss)] // counts far below 2⁵²
            let mean = count as f64 / ticks.len() as f64;
            println!("{mean:8.1}  {name}");
        }
        Ok(())
    }

    fn guarded_frames(&self) -> Result<Frames, Box<dyn Error>> {
        let rig = self.rig(0x10)?;
        let latch = rig.board.trace("TIM5")?;
        let frame = rig.board.trace("robot_frame")?;
        let tick = rig.board.trace("robot_tick")?;
        rig.board.follow_select();
        rig.board.follow_writes(DMA2_S3CR);
        let inner = normal_frame(200_000, 0, 0, true);
        for own in 1..=200_u8 {
            let mut bytes = [0; 26];
            bytes[..2].copy_from_slice(&[KEY_PI, own]);
            bytes[6..24].copy_from_slice(&inner[1..]);
            let crc = crc16(&bytes[..24]);
            bytes[24..].copy_from_slice(&crc.to_be_bytes());
            let _ = rig.frame(&bytes);
            rig.board.run_us(25_000);
        }
        if rig.log().contains("rejected") {
            return Err(format!("a guarded frame was rejected: {}", rig.log()).into());
        }
        let events = rig.board.take_events();
        let latches = spans(&latch, &events);
        let waited: Vec<Span> = spans(&tick, &events)
            .into_iter()
            .chain(latches.iter().copied())
            .collect();
        Ok(Frames {
            core: core(&spans(&frame, &events), &latches)?,
            whole: to_reply(&events, &spans(&frame, &events), &waited)?,
        })
    }

    /// How far the latching of the tick strays from its 10 ms under back-to-back frames: the worst
    /// distance of two ticks from the period.
    fn jitter_us(&self) -> Result<f64, Box<dyn Error>> {
        let rig = self.rig(0)?;
        rig.board.follow_writes(TIM5_CCR1);
        let period = 2 * SETUP_NS + NORMAL * 1_000 + GAP_NS;
        let frame = normal_frame(500_000, 0, 0, true);
        for _ in 0..20 {
            rig.board
                .spi_raw(burst(&frame, 8_000_000, period, 50_000_000 / period))?;
        }
        let at: Vec<u64> = rig
            .board
            .take_events()
            .iter()
            .filter(|event| matches!(event.what, What::Wrote { .. }))
            .map(|event| event.at_ns)
            .collect();
        let worst = at
            .windows(2)
            .map(|pair| (pair[1] - pair[0]).abs_diff(TICK_NS))
            .max()
            .ok_or("no tick was seen")?;
        #[allow(clippy::cast_precision_loss)] // nanoseconds far below 2⁵²
        Ok(worst as f64 / 1000.0)
    }

    /// The highest of [`RATES`] at which a virtual second passes without a frame lost, rejected,
    /// repeated or torn, driving meanwhile.
    fn sustained(&self, hz: u64) -> Result<u64, Box<dyn Error>> {
        let mut best = 0;
        for rate in RATES {
            let period = 1_000_000_000 / rate;
            if period < 2 * SETUP_NS + NORMAL * 8_000_000_000 / hz + GAP_NS {
                break;
            }
            let rig = self.rig(0)?;
            if !lossless(&rig, hz, period, rate)? {
                break;
            }
            best = rate;
        }
        Ok(best)
    }
}

/// A virtual second of frames; whether every one was taken and answered anew.
fn lossless(rig: &Rig, hz: u64, period: u64, rate: u64) -> Result<bool, Box<dyn Error>> {
    let frame = normal_frame(500_000, 0, 0, true);
    let mut last = None;
    for _ in 0..10 {
        let bits = rig.board.spi_raw(burst(&frame, hz, period, rate / 10))?;
        for bytes in twin::components::spi_master::pack(&bits).chunks(frame.len()) {
            let reply = NormalReply::of(bytes);
            // The cells take turns: the same one again is an old reply.
            let fresh = last.replace(reply.cell) != Some(reply.cell);
            if reply.key != KEY_STM || reply.not_used || reply.cell > 1 || !fresh {
                return Ok(false);
            }
        }
    }
    rig.board.run_us(50_000);
    let log = rig.log();
    Ok(!log.contains("rejected") && !log.contains("lost") && !rig.motors_off())
}

/// The core's part of every frame, without the handlers that pre-empted it.
fn core(handled: &[Span], preempting: &[Span]) -> Result<Spread, &'static str> {
    let taken: Vec<u64> = without(handled, preempting)
        .iter()
        .map(|span| span.instructions)
        .collect();
    Spread::of(&taken).ok_or("no frame was seen")
}

/// From every chip-select's rise until the transmitting stream holds the reply to that frame: the
/// first time after the core's part that the stream is enabled. Instructions, without those of
/// `others` (a tick the frame had to wait for, echoes timed meanwhile).
fn to_reply(events: &[Event], handled: &[Span], others: &[Span]) -> Result<Spread, &'static str> {
    let taken: Vec<u64> = handled
        .iter()
        .filter_map(|span| {
            let left = span.entered + span.instructions;
            let rise = events
                .iter()
                .rfind(|event| event.what == What::Select(false) && event.at_ns <= span.entered_ns)?
                .instructions;
            let armed = events
                .iter()
                .find(|event| {
                    event.instructions >= left
                        && matches!(event.what, What::Wrote { address: DMA2_S3CR, value } if value & 1 == 1)
                })?
                .instructions;
            let elsewhere: u64 = others
                .iter()
                .map(|other| {
                    let ends = (other.entered + other.instructions).min(armed);
                    ends.saturating_sub(other.entered.max(rise))
                })
                .sum();
            Some((armed - rise).saturating_sub(elsewhere))
        })
        .collect();
    Spread::of(&taken).ok_or("no frame was seen")
}
