//! Faults on a driving robot, each alone and every pair, at random instants, on the release ELF in mode 0x30.
//!
//! Whatever fails, six things must hold: no motor is on later than the stop deadline and a tick after the last
//! whole frame, and none while the robot reports a stop; no wheel turns against its command; no configuration is
//! accepted that was not written; no reply lies; every fault is reported; and it drives again afterwards, its pose
//! unharmed where the fault does not concern it.
#![forbid(unsafe_code)]

mod faults;
mod replies;
mod soak;
mod trial;

use std::collections::BTreeMap;
use std::error::Error;
use std::fs;
use std::path::PathBuf;

use clap::Parser;

use faults::{CRYSTAL, KINDS, combinations};
use robot_tests::test_board::elf_of_mortal_crystal;
use soak::Soak;
use trial::Trial;

/// Injects faults while the robot drives, and checks what it does.
#[derive(Parser)]
struct Arguments {
    /// The release ELF
    #[arg(long)]
    elf: PathBuf,
    /// Hours of virtual time
    #[arg(long, default_value_t = 1.0)]
    hours: f64,
    /// Seed of order, instants and durations: a shard has its own
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Only this trial, with its log
    #[arg(long, conflicts_with = "soak")]
    trial: Option<u64>,
    /// One robot for the whole time that explores, stands and is left alone
    #[arg(long)]
    soak: bool,
}

#[expect(clippy::cast_precision_loss, reason = "hours")]
fn main() -> Result<(), Box<dyn Error>> {
    twin::processor::keep_to_one();
    let arguments = Arguments::parse();
    let elf = fs::read(&arguments.elf)?;
    if arguments.soak {
        let clean = Soak::new(&elf, arguments.seed)?
            .run(arguments.hours)
            .then_some(());
        return Ok(clean.ok_or("the soak has findings")?);
    }
    let mortal = elf_of_mortal_crystal(elf.clone());
    let order = combinations(arguments.seed);
    let (mut seconds, mut worst_stop_us, mut found) = (0.0, 0, BTreeMap::<&str, u32>::new());
    let mut number = arguments.trial.unwrap_or(0);
    let ends = arguments.trial.map_or(u64::MAX, |only| only + 1);
    while seconds < arguments.hours * 3600.0 && number < ends {
        let (a, b) = order[usize::try_from(number)? % order.len()];
        let kinds = [&KINDS[a], &KINDS[b]];
        let kinds = &kinds[usize::from(a == b)..];
        let dies = kinds.iter().any(|kind| kind.0 == CRYSTAL);
        let elf = if dies { &mortal } else { &elf };
        let mut trial = Trial::new(elf, arguments.seed << 32 | number)?;
        trial.run(kinds);
        seconds += trial.board.now_us() as f64 / 1e6;
        worst_stop_us = worst_stop_us.max(trial.seen.worst_stop_us);
        let names: Vec<_> = kinds.iter().map(|kind| kind.0).collect();
        for (kind, finding) in &trial.seen.findings {
            println!("trial {number}, {}: {finding}", names.join(" and "));
            *found.entry(*kind).or_default() += 1;
        }
        if arguments.trial.is_some() {
            print!("{}", String::from_utf8_lossy(&trial.board.uart()));
        }
        number += 1;
    }
    println!(
        "seed {}, {:.2} virtual hours, {number} trials of {} faults and pairs, \
         motors on at most {:.1} ms after the last whole frame; findings: {found:?}",
        arguments.seed,
        seconds / 3600.0,
        order.len(),
        worst_stop_us as f64 / 1000.0
    );
    let clean = found.is_empty().then_some(());
    Ok(clean.ok_or("the campaign has findings")?)
}
