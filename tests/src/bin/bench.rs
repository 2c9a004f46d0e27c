//! The odometry beside the ways one would try first, on the emulated core: instructions of a step, its
//! call included, and the error after a kilometre, as a table.
//!
//! What the core came to must be what the host came to, to the bit: then the errors, which the host worked
//! out, are the core's.
#![forbid(unsafe_code)]

use std::error::Error;
use std::fs;
use std::path::PathBuf;

use clap::Parser;
use object::{Object, ObjectSymbol};
use twin::trace::spans;
use twin::{Board, Options};

/// Longest the ELF may take, microseconds of virtual time.
const LIMIT_US: u64 = 20_000_000;

/// What a way is, for the reader.
const WAYS: [(&str, &str); 6] = [
    ("Odometry::step", "ours"),
    ("Double::step", "the document's formulas, `f64`, `libm`"),
    ("Single::step", "the same, `f32`, `libm`"),
    ("Micromath::step", "the same, `f32`, `micromath`"),
    ("Cordic::step", "the same, `I32F32`, `cordic`"),
    ("Idsp::step", "`i32` phase, `idsp::cossin`"),
];

/// Prints the odometry beside others.
#[derive(Parser)]
struct Arguments {
    /// The ELF
    #[arg(long)]
    elf: PathBuf,
    /// The lines that the host printed
    #[arg(long)]
    host: PathBuf,
}

/// A line of the host's.
struct Line {
    bits: [u64; 3],
    curves: f64,
    straight: f64,
}

fn line(text: &str, name: &str) -> Option<Line> {
    let mut words = text.split_whitespace();
    (words.next()? == name).then_some(())?;
    let mut hexadecimal = || u64::from_str_radix(words.next()?, 16).ok();
    Some(Line {
        bits: [hexadecimal()?, hexadecimal()?, hexadecimal()?],
        curves: words.next()?.parse().ok()?,
        straight: words.next()?.parse().ok()?,
    })
}

fn main() -> Result<(), Box<dyn Error>> {
    let Arguments { elf, host } = Arguments::parse();
    let (elf, host) = (fs::read(elf)?, fs::read_to_string(host)?);
    let file = object::File::parse(&*elf)?;
    let results = file
        .symbols()
        .find(|symbol| symbol.name().is_ok_and(|name| name.contains("7RESULTS")))
        .ok_or("the ELF has no RESULTS")?
        .address();
    let board = Board::new(&elf, Options::default())?;
    let functions = WAYS
        .iter()
        .map(|(name, _)| board.trace(name))
        .collect::<Result<Vec<_>, _>>()?;
    let words = 6 * WAYS.len() as u64;
    while board.words(results + 4 * words, 1) != [1] {
        if board.now_us() >= LIMIT_US {
            return Err("the ELF has not come to its end in time".into());
        }
        board.run_us(50_000);
    }
    let found = board.words(results, words);
    let events = board.take_events();
    println!("| way | instructions a step | error after 1 km of curves | after 1 km straight on |");
    println!("|---|---|---|---|");
    for (nth, ((name, about), function)) in WAYS.iter().zip(&functions).enumerate() {
        let expected = host
            .lines()
            .find_map(|text| line(text, name))
            .ok_or_else(|| format!("the host has no line for {name}"))?;
        let bits: Vec<u64> = found[6 * nth..6 * nth + 6]
            .chunks_exact(2)
            .map(|pair| u64::from(pair[1]) << 32 | u64::from(pair[0]))
            .collect();
        if bits != expected.bits {
            let host = expected.bits;
            return Err(
                format!("{name}: the core came to {bits:x?}, the host to {host:x?}").into(),
            );
        }
        // And the call.
        let steps = spans(function, &events).into_iter();
        let steps: Vec<u64> = steps.map(|span| span.instructions + 1).collect();
        let most = steps.iter().max();
        let most = most.ok_or_else(|| format!("{name} was never called"))?;
        #[allow(clippy::cast_precision_loss)] // counts far below 2⁵²
        let mean = steps.iter().sum::<u64>() as f64 / steps.len() as f64;
        let [curves, straight] = [expected.curves, expected.straight].map(micrometres);
        println!("| {about} | {mean:.0} (most {most}) | {curves} | {straight} |");
    }
    Ok(())
}

/// In the unit that suits it.
fn micrometres(value: f64) -> String {
    if value < 0.1 {
        format!("{:.2} nm", value * 1e3)
    } else if value < 1e3 {
        format!("{value:.2} µm")
    } else {
        format!("{:.1} mm", value / 1e3)
    }
}
