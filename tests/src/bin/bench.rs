//! The odometry beside the ways one would try first, on the emulated core: instructions of a step, its
//! call included, and the error after a kilometre, as a table.
//!
//! `bench --elf PATH --host FILE`: the ELF and the lines of `tests/bench`. What the core came to must be
//! what the host came to, to the bit: then the errors, which the host worked out, are the core's.
#![forbid(unsafe_code)]

use std::error::Error;
use std::fs;

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

/// Compares the odometry with others.
#[derive(Parser)]
struct Arguments {
    /// The candidates, built for the core
    #[arg(long)]
    elf: String,
    /// What the candidates printed on the host
    #[arg(long)]
    host: String,
}

fn main() {
    let Arguments { elf, host } = Arguments::parse();
    if let Err(error) = run(&elf, &host) {
        eprintln!("bench: {error}");
        std::process::exit(1);
    }
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
    let bits = [hexadecimal()?, hexadecimal()?, hexadecimal()?];
    Some(Line {
        bits,
        curves: words.next()?.parse().ok()?,
        straight: words.next()?.parse().ok()?,
    })
}

fn run(elf: &str, host: &str) -> Result<(), Box<dyn Error>> {
    let elf = fs::read(elf).map_err(|error| format!("{elf}: {error}"))?;
    let host = fs::read_to_string(host).map_err(|error| format!("{host}: {error}"))?;
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
    let mut done = Err("the ELF has not come to its end in time".to_owned());
    while board.now_us() < LIMIT_US {
        board.run_us(50_000);
        if board.words(results + 4 * words, 1) == [1] {
            done = Ok(());
            break;
        }
    }
    done?;
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
            return Err(format!(
                "{name}: the core came to {bits:x?}, the host to {:x?}",
                expected.bits
            )
            .into());
        }
        // And the call.
        let steps: Vec<u64> = spans(function, &events)
            .iter()
            .map(|span| span.instructions + 1)
            .collect();
        let most = steps
            .iter()
            .max()
            .ok_or_else(|| format!("{name} was never called"))?;
        #[allow(clippy::cast_precision_loss)] // counts far below 2⁵²
        let mean = steps.iter().sum::<u64>() as f64 / steps.len() as f64;
        println!(
            "| {about} | {mean:.0} (most {most}) | {} | {} |",
            micrometres(expected.curves),
            micrometres(expected.straight),
        );
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
