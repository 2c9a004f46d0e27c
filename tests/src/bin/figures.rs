//! Measures the release ELF on the emulated core: `target/figures.json`, and the same as a table.
//!
//! How each figure is measured is in docs/figures.md, the bars are in ci/budget.toml.
#![forbid(unsafe_code)]

use std::cell::Cell;
use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};

use clap::Parser;
use object::{Object, ObjectSection, ObjectSegment, SectionKind};
use robot_tests::reference::{guarded_frame, image_in_mode, normal_frame};
use robot_tests::stack::Stack;
use robot_tests::test_board::Rig;
use robot_tests::throughput::{
    jitter_us, long_run, lossless, shortest_period, sustained, torn_frames,
};
use serde::Serialize;
use serde_json::{Value, json};
use twin::trace::{Event, EventKind, Span, TracedFunction, cycles, exclusive, shares, spans};
use twin::{Board, Options};

type Result<T> = std::result::Result<T, Box<dyn Error>>;

/// The control register of the stream that feeds SPI1 (RM0383, 9.5.5): bit 0 enables it.
const DMA2_S3CR: u64 = 0x4002_6458;
const SELECTED: EventKind = EventKind::ChipSelect(true);
/// The long run: SPI clock, frames a second, virtual seconds. The rate is no multiple of the tick's, so
/// the frames pass through all of its phases.
const LONG: (u64, u64, u64) = (12_000_000, 10_007, 10);
/// The handlers above the robot's priority, and the others at it; the end of a frame belongs to the frame.
const TIMED: [&str; 4] = ["TIM5", "EXTI0", "EXTI9_5", "EXTI15_10"];
const BESIDE: [&str; 4] = ["DMA2_STREAM7", "I2C1_EV", "I2C1_ER", "DMA1_STREAM0"];
/// Instructions of the original C++ to decode a Normal frame and encode its reply on this core at -O2.
const ORIGINAL: f64 = 4947.0;

#[derive(Clone, Copy, Serialize)]
struct Spread {
    min: u64,
    mean: f64,
    max: u64,
    samples: usize,
}

impl Spread {
    /// Of the instructions of `runs`, with `extra` added to each.
    fn of(runs: &[Span], extra: u64) -> Result<Self> {
        let counts: Vec<_> = runs.iter().map(|run| run.instructions + extra).collect();
        Self::of_counts(&counts)
    }

    #[allow(clippy::cast_precision_loss)] // counts far below 2⁵²
    fn of_counts(counts: &[u64]) -> Result<Self> {
        let (Some(&min), Some(&max)) = (counts.iter().min(), counts.iter().max()) else {
            return Err("a measured function was never called".into());
        };
        Ok(Self {
            min,
            mean: counts.iter().sum::<u64>() as f64 / counts.len() as f64,
            max,
            samples: counts.len(),
        })
    }
}

/// Measures the release ELF on the emulated core and prints a table.
#[derive(Parser)]
struct Arguments {
    /// The release ELF
    #[arg(long)]
    elf: PathBuf,
    /// The reference codec of `tests/bench`
    #[arg(long)]
    reference: PathBuf,
    /// Where the figures go
    #[arg(long, default_value = "target/figures.json")]
    out: PathBuf,
    /// Print where the instructions of a tick and of a frame go instead
    #[arg(long)]
    profile: bool,
}

fn read(path: &Path) -> Result<Vec<u8>> {
    fs::read(path).map_err(|error| format!("{}: {error}", path.display()).into())
}

fn main() -> Result<()> {
    twin::processor::keep_to_one();
    let arguments = Arguments::parse();
    let firmware = Firmware {
        elf: read(&arguments.elf)?,
        stack_used: Cell::new(0),
    };
    if arguments.profile {
        return firmware.profile();
    }
    let figures = firmware.measure(&read(&arguments.reference)?)?;
    let out = &arguments.out;
    if let Some(folder) = out.parent() {
        fs::create_dir_all(folder)?;
    }
    fs::write(out, serde_json::to_string_pretty(&figures)? + "\n")?;
    for (name, value) in figures.as_object().into_iter().flatten() {
        let number = |key: &str| value[key].as_f64().unwrap_or(f64::NAN);
        let text = if value.is_object() {
            let (min, mean, max) = (number("min"), number("mean"), number("max"));
            format!("{min} / {mean:.0} / {max} (n {})", number("samples"))
        } else if value.is_f64() {
            format!("{:.2}", value.as_f64().unwrap_or(f64::NAN))
        } else {
            value.to_string()
        };
        println!("{name:36} {text:>34}");
    }
    Ok(())
}

/// Bytes to be flashed, and bytes of RAM reserved beside the stack.
fn sizes(elf: &[u8]) -> Result<(u64, u64)> {
    let file = object::File::parse(elf)?;
    let flash = file.segments().map(|segment| segment.file_range().1).sum();
    let kinds = [SectionKind::Data, SectionKind::UninitializedData];
    let ram = file.sections().filter(|section| {
        let in_ram = (0x2000_0000..0x4000_0000).contains(&section.address());
        in_ram && kinds.contains(&section.kind())
    });
    Ok((flash, ram.map(|section| section.size()).sum()))
}

/// Instructions of a Normal frame in the reference codec, and in the core's strategies alone.
fn codecs(elf: &[u8]) -> Result<(Spread, Spread)> {
    let board = Board::new(elf, Options::default())?;
    let (reference, core) = (board.trace("reference_codec")?, board.trace("core_codec")?);
    board.run_us(10_000);
    let events = board.take_events();
    Ok((
        Spread::of(&spans(&reference, &events), 0)?,
        Spread::of(&spans(&core, &events), 0)?,
    ))
}

/// Instructions of frames: in the core, and from the rise of chip-select until the reply is armed.
struct Frames {
    core: Spread,
    whole: Spread,
}

impl Frames {
    /// `handled` are the core's parts; `preempting` interrupted them; `waited` were served first.
    fn of(
        events: &[Event],
        handled: &[Span],
        preempting: &[Span],
        waited: &[Span],
    ) -> Result<Self> {
        let whole = handled
            .iter()
            .filter_map(|core| to_reply(events, core, waited));
        Ok(Self {
            core: Spread::of(&exclusive(handled, preempting), 0)?,
            whole: Spread::of_counts(&whole.collect::<Vec<_>>())?,
        })
    }
}

/// From the rise of chip-select before `core` until the transmitting stream is enabled in it, without the
/// instructions of `others`.
fn to_reply(events: &[Event], core: &Span, others: &[Span]) -> Option<u64> {
    let rises = |event: &&Event| {
        event.kind == EventKind::ChipSelect(false) && event.at_ns <= core.entered_ns
    };
    let rise = events.iter().rfind(rises)?.instructions;
    let enables = |kind: &EventKind| matches!(kind, EventKind::Write { address: DMA2_S3CR, value } if value & 1 == 1);
    // An answer that is late leaves the standby armed.
    let mut after = events
        .iter()
        .skip_while(|event| event.instructions < core.entered);
    let next = after.find(|event| enables(&event.kind) || event.kind == SELECTED)?;
    let armed = (next.kind != SELECTED).then_some(next.instructions)?;
    let mut others: Vec<_> = others.iter().collect();
    others.sort_by_key(|other| other.entered);
    let (mut own, mut seen) = (armed - rise, rise);
    // They pre-empt each other: nothing counts twice.
    for other in others {
        let end = (other.entered + other.instructions).min(armed);
        own -= end.saturating_sub(other.entered.max(seen));
        seen = seen.max(end);
    }
    Some(own)
}

/// The ELF under measurement.
struct Firmware {
    elf: Vec<u8>,
    /// The most of the stack that any run has used, bytes.
    stack_used: Cell<u64>,
}

impl Firmware {
    /// Boots the robot in `mode` and runs `test` on it.
    fn with_robot<T>(&self, mode: u8, test: impl FnOnce(&Rig) -> Result<T>) -> Result<T> {
        let options = Options::with_eeprom(image_in_mode(mode));
        let rig = Rig::with_elf(&self.elf, options);
        let stack = Stack::paint(&self.elf, &rig.board)?;
        rig.assert_ready();
        let result = test(&rig)?;
        let used = stack.used(&rig.board);
        self.stack_used.set(self.stack_used.get().max(used));
        Ok(result)
    }

    #[allow(clippy::cast_precision_loss)] // counts far below 2⁵²
    fn measure(&self, reference: &[u8]) -> Result<Value> {
        let (flash_bytes, static_ram_bytes) = sizes(&self.elf)?;
        let (tick, odometry_step, frames) = self.with_robot(0, driving)?;
        let guarded = self.with_robot(0x10, guarded_frames)?;
        let (hand, codec) = codecs(reference)?;
        let wire = |hz| 1_000_000_000 / shortest_period(hz);
        let (hz, rate, seconds) = LONG;
        let long = long_run(&self.elf, hz, rate, seconds)?;
        let torn = torn_frames(&self.elf, hz, rate);
        let lossless = |hz, rate| self.with_robot(0, |rig| Ok(lossless(rig, hz, rate)));
        let at_8_mhz = sustained(8_000_000, lossless)?;
        let at_12_mhz = sustained(12_000_000, lossless)?;
        Ok(json!({
            "flash_bytes": flash_bytes,
            "static_ram_bytes": static_ram_bytes,
            "mips_estimate": self.with_robot(0, mips_estimate)?,
            "boot_to_ready_us": self.with_robot(0, boot_to_ready_us)?,
            "tick_instructions": tick,
            "odometry_step_instructions": odometry_step,
            "frame_core_instructions": frames.core,
            "guarded_frame_core_instructions": guarded.core,
            "frame_instructions": frames.whole,
            "guarded_frame_instructions": guarded.whole,
            "hand_frame_instructions": hand,
            "codec_frame_instructions": codec,
            "frame_core_to_hand": frames.core.mean / hand.mean,
            "codec_to_hand": codec.mean / hand.mean,
            "original_to_frame_core": ORIGINAL / frames.core.mean,
            "tick_jitter_us": self.with_robot(0, |rig| Ok(jitter_us(rig)))?,
            "frames_per_s_sustained": at_8_mhz,
            "frames_per_s_wire_limit": wire(8_000_000),
            "frames_per_s_sustained_12_mhz": at_12_mhz,
            "frames_per_s_wire_limit_12_mhz": wire(12_000_000),
            "sustained_to_wire_12_mhz": at_12_mhz as f64 / wire(12_000_000) as f64,
            "long_run_frames_per_s": rate,
            "long_run_frames": long.frames,
            "long_run_lost": long.lost,
            "long_run_stale": long.stale,
            "long_run_oldest_us": long.oldest_us,
            "long_run_tick_jitter_us": long.jitter_us,
            "tick_jitter_without_frames_us": long.jitter_without_frames_us,
            "frames_lost_per_tear": torn.lost as f64 / torn.torn as f64,
            "stack_used_bytes": self.stack_used.get(),
        }))
    }

    /// The spreads of the instructions, and the tick's mean by function over two seconds of the same drive.
    fn profile(&self) -> Result<()> {
        let (tick, step, frames) = self.with_robot(0, driving)?;
        let guarded = self.with_robot(0x10, guarded_frames)?;
        for (name, Spread { min, mean, max, .. }) in [
            ("tick", tick),
            ("odometry step", step),
            ("frame core", frames.core),
            ("frame", frames.whole),
            ("guarded frame core", guarded.core),
            ("guarded frame", guarded.whole),
        ] {
            println!("{name:18} {min} / {mean:.0} / {max} instructions");
        }
        let ready_us = self.with_robot(0, boot_to_ready_us)?;
        println!("{:18} {ready_us} µs after reset", "READY");
        let mips = self.with_robot(0, mips_estimate)?;
        println!("{:18} {mips:.1} at 100 MHz, estimated", "MIPS");
        self.with_robot(0, |rig| profile_of(rig, "robot_tick"))?;
        self.with_robot(0, |rig| profile_of(rig, "robot_frame"))
    }
}

fn boot_to_ready_us(rig: &Rig) -> Result<u64> {
    let outputs = rig.board.outputs();
    let ready = outputs
        .iter()
        .find(|change| change.pin == twin::pinout::READY && change.high)
        .ok_or("READY never rose")?;
    Ok(ready.at.div_ceil(1000))
}

/// Traces these functions, and what else tells when a frame ends and its answer is armed.
fn trace_frames(rig: &Rig, names: &[&str]) -> Result<Vec<TracedFunction>> {
    rig.board.trace_chip_select();
    rig.board.trace_writes(DMA2_S3CR);
    let traced = names.iter().map(|name| rig.board.trace(name));
    Ok(traced.collect::<std::result::Result<_, _>>()?)
}

/// Ticks, odometry steps and Normal frames while driving to a pose at 40 frames a second.
fn driving(rig: &Rig) -> Result<(Spread, Spread, Frames)> {
    let handlers = [
        "robot_tick",
        "Odometry::step",
        "robot_frame",
        "EXTI4",
        "robot_answer",
    ];
    let traced = trace_frames(rig, &[&handlers[..], &TIMED, &BESIDE].concat())?;
    let _ = rig.keep_sending(&normal_frame(700_000, 400_000, 0x2000, true), 20_000_000);
    let events = rig.board.take_events();
    let runs: Vec<_> = traced.iter().map(|traced| spans(traced, &events)).collect();
    let [ticks, steps, frames, edges, answers, others @ ..] = &runs[..] else {
        return Err("every traced function has its runs".into());
    };
    let (timed, beside) = others.split_at(TIMED.len());
    let latches = &timed[0];
    // The latch that belongs to a tick is the longest run of its handler.
    let latch = latches.iter().map(|span| span.instructions).max();
    let timed = timed.concat();
    let preempting = [&timed[..], edges].concat();
    let waited = [&timed[..], &beside.concat(), ticks].concat();
    Ok((
        Spread::of(&exclusive(ticks, &preempting), latch.unwrap_or(0))?,
        // And the call.
        Spread::of(&exclusive(steps, &preempting), 1)?,
        Frames::of(
            &events,
            frames,
            &[&preempting[..], answers].concat(),
            &waited,
        )?,
    ))
}

fn guarded_frames(rig: &Rig) -> Result<Frames> {
    let handlers = ["robot_tick", "robot_frame", "robot_answer"];
    let traced = trace_frames(rig, &[&handlers[..], &TIMED, &BESIDE].concat())?;
    let inner = normal_frame(200_000, 0, 0, true);
    for own in 1..=200_u8 {
        let _ = rig.frame(&guarded_frame(own, 0, &inner));
        rig.board.run_us(25_000);
    }
    if rig.log().contains("rejected") {
        return Err(format!("a guarded frame was rejected: {}", rig.log()).into());
    }
    let events = rig.board.take_events();
    let runs: Vec<_> = traced.iter().map(|traced| spans(traced, &events)).collect();
    let [ticks, frames, answers, others @ ..] = &runs[..] else {
        return Err("every traced function has its runs".into());
    };
    let timed = others[..TIMED.len()].concat();
    let waited = [&others.concat()[..], ticks].concat();
    let beside = [&timed[..], answers].concat();
    Frames::of(&events, frames, &beside, &waited)
}

/// Millions of instructions a second at 100 MHz, over two seconds of the same drive.
fn mips_estimate(rig: &Rig) -> Result<f64> {
    let target = normal_frame(700_000, 400_000, 0x2000, true);
    let code = rig.board.profile()?;
    let _ = rig.keep_sending(&target, 2_000_000);
    let (cycles, count) = cycles(&code, &rig.board.take_events());
    #[allow(clippy::cast_precision_loss)] // counts far below 2⁵²
    Ok(100.0 * count as f64 / cycles as f64)
}

/// The mean instructions of a function by callee, over two seconds of the same drive.
fn profile_of(rig: &Rig, name: &str) -> Result<()> {
    let target = normal_frame(700_000, 400_000, 0x2000, true);
    let _ = rig.keep_sending(&target, 2_000_000);
    let function = rig.board.trace(name)?;
    let code = rig.board.profile()?;
    let _ = rig.keep_sending(&target, 2_000_000);
    let events = rig.board.take_events();
    let runs = spans(&function, &events);
    println!("instructions of {name}, mean of {} runs", runs.len());
    for (name, count) in shares(&code, &runs, &events) {
        #[allow(clippy::cast_precision_loss)] // counts far below 2⁵²
        let mean = count as f64 / runs.len() as f64;
        println!("{mean:8.1}  {name}");
    }
    Ok(())
}
