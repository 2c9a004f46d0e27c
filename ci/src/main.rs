//! The gates, the demo and the set-up, as one program: `cargo xtask …`.
#![forbid(unsafe_code)]

mod arm;
mod bench;
mod code;
mod coverage;
mod defects;
mod elf;
mod error;
mod firmware;
mod flash;
mod fuzz;
mod gates;
mod gdb;
mod json;
mod kani;
mod lines;
mod mirror;
mod mutants;
mod numbers;
mod place;
mod robot;
mod shard;
mod shell;
mod stack;
mod tool;
mod trace;

use std::process::ExitCode;

use arm::{Arm, Way};
use error::{failed, Error, Of, Result};
use firmware::Edition;
use fuzz::{Effort, Fuzzer};
use place::Place;
use shard::Shard;

const USAGE: &str = "\
usage: cargo xtask COMMAND [OPTIONS]

  setup                     find or install a way to build for the robot's processor
  firmware [--minimal] [--features F]
                            build the ELF that is flashed, print its path and sizes
  stack [--minimal] [--features F]
                            the worst its stack can come to, with the calls that lead there
  demo [ARGS]               the virtual robot drives the default room: target/demo/
  figures [ARGS]            measure the ELF on the emulated core: target/figures.json;
                            with --profile, where the tick's instructions go
  bench                     the odometry beside others on the emulated core, as a table
  robot ARGS                the Pi's program on the virtual board, e.g. `robot goto 500 0 90`
  flash [--minimal] [--virtual] [--serial DEVICE] [--interface NAME]
                            flash, verify, reset, show the first log lines
  debug [--minimal] [--virtual] [--interface NAME]
                            the debugger, on the board or on the virtual one
  test [--quick] [--only GATE[,GATE]] [--may-skip GATE[,GATE]]
                            every gate a change must pass, with a table; with --may-skip it fails
                            where any other is SKIPPED
  prove [--shard K/N]       the theorems, by Kani; or every N-th of them, K from 0
  fuzz [TARGET] [--seconds N] [--minimise]
                            fuzz one target or all; with --minimise, put what was learned into
                            the committed corpus, as few inputs as reach as much
  trace                     every requirement with the code that meets it and what checks that
  defects [--only NAME[,NAME]]
                            make the code wrong on purpose; some gate must notice
  mutants [--file F[,F]] [--only TEXT[,TEXT]] [--shard K/N] [--jobs N] [--quick]
                            change fw-core in every way; some test must notice; with --quick,
                            what the quick tests beside the code alone do not
  coverage                  how much of fw-core the tests run, and what they do not

  --minimal takes the firmware without its optional parts (sweep, gyro), at most 32 KiB.
  --way installed|rustup|debian (or the variable ROBOT_WAY) forces how the firmware is built.
  Exit codes: 0 done, 1 something failed, 2 wrong words, 3 no way to build the firmware,
  4 a program is missing, 5 the board did not answer or does not hold the firmware.
";

/// The words after the command, taken apart.
#[derive(Default)]
struct Words {
    plain: Vec<String>,
    options: Vec<(String, String)>,
    flags: Vec<String>,
    /// For another program.
    rest: Vec<String>,
}

const WITH_VALUE: [&str; 10] = [
    "--features",
    "--file",
    "--jobs",
    "--may-skip",
    "--only",
    "--seconds",
    "--shard",
    "--way",
    "--serial",
    "--interface",
];
const WITHOUT: [&str; 4] = ["--virtual", "--quick", "--minimal", "--minimise"];

/// Commands whose words are another program's, but for `--way`.
const HANDED_ON: [&str; 3] = ["demo", "figures", "robot"];

impl Words {
    fn parse(command: &str, words: impl Iterator<Item = String>) -> Result<Self> {
        let mut parsed = Self::default();
        let mut words = words;
        let ours = !HANDED_ON.contains(&command);
        while let Some(word) = words.next() {
            if word == "--" {
                parsed.rest.extend(words);
                break;
            }
            if !ours && word != "--way" && !word.starts_with("--way=") {
                parsed.rest.push(word);
                continue;
            }
            let (name, value) = match word.split_once('=') {
                Some((name, value)) => (name.to_owned(), Some(value.to_owned())),
                None => (word.clone(), None),
            };
            if WITH_VALUE.contains(&name.as_str()) {
                let value = value.or_else(|| words.next());
                let value = value.ok_or_else(|| Error::Usage(format!("{name} needs a value")))?;
                parsed.options.push((name, value));
            } else if WITHOUT.contains(&word.as_str()) {
                parsed.flags.push(word);
            } else if word.starts_with('-') {
                return Err(Error::Usage(format!("unknown option {word}\n\n{USAGE}")));
            } else {
                parsed.plain.push(word);
            }
        }
        Ok(parsed)
    }

    fn option(&self, name: &str) -> Option<&str> {
        self.options
            .iter()
            .rev()
            .find(|(found, _)| found == name)
            .map(|(_, value)| value.as_str())
    }

    /// The names of an option, which commas part; of all of them where it is given several times.
    fn list(&self, name: &str) -> Vec<String> {
        let given = self.options.iter().filter(|(found, _)| found == name);
        let names = given.flat_map(|(_, names)| names.split(','));
        names
            .map(str::trim)
            .filter(|name| !name.is_empty())
            .map(str::to_owned)
            .collect()
    }

    /// A whole number, or what it is where nothing is said.
    fn number<N: std::str::FromStr>(&self, name: &str, default: N) -> Result<N> {
        self.option(name).map_or(Ok(default), |value| {
            let number = value.parse();
            number.map_err(|_| Error::Usage(format!("{name} {value}: not a whole number")))
        })
    }

    /// All, where there is no `--shard`.
    fn shard(&self) -> Result<Shard> {
        let shard = self.option("--shard").map(Shard::parse).transpose()?;
        Ok(shard.unwrap_or_default())
    }

    fn flag(&self, name: &str) -> bool {
        self.flags.iter().any(|found| found == name)
    }

    fn edition(&self) -> Edition {
        if self.flag("--minimal") {
            Edition::Minimal
        } else {
            Edition::Full
        }
    }

    /// Refuses what this command would not look at.
    fn only(&self, plain: usize, rest: bool, options: &[&str]) -> Result<()> {
        if self.plain.len() > plain {
            return Err(Error::Usage(format!(
                "unexpected word {}\n\n{USAGE}",
                self.plain[plain]
            )));
        }
        if !rest && !self.rest.is_empty() {
            return Err(Error::Usage(format!(
                "nothing goes after -- here\n\n{USAGE}"
            )));
        }
        let given = self.options.iter().map(|(name, _)| name).chain(&self.flags);
        for name in given {
            if name != "--way" && !options.contains(&name.as_str()) {
                return Err(Error::Usage(format!(
                    "{name} does not go with this command\n\n{USAGE}"
                )));
            }
        }
        Ok(())
    }
}

fn main() -> ExitCode {
    let mut words = std::env::args().skip(1);
    let command = words.next().unwrap_or_default();
    match Words::parse(&command, words).and_then(|words| dispatch(&command, &words)) {
        Ok(code) => code,
        Err(error) => {
            eprintln!("xtask {command}: {error}");
            ExitCode::from(error.code())
        }
    }
}

fn dispatch(command: &str, words: &Words) -> Result<ExitCode> {
    let forced = words
        .option("--way")
        .map(str::to_owned)
        .or_else(|| std::env::var("ROBOT_WAY").ok());
    let forced = forced.map(|name| Way::from_name(&name)).transpose()?;
    match command {
        "setup" => {
            words.only(0, false, &[])?;
            Arm::find(&Place::find()?, forced)?;
        }
        "firmware" => {
            words.only(0, false, &["--features", "--minimal"])?;
            build(
                &Place::find()?,
                forced,
                words.edition(),
                words.option("--features").unwrap_or(""),
            )?;
        }
        "stack" => {
            words.only(0, false, &["--features", "--minimal"])?;
            print_stack(&Place::find()?, forced, words)?;
        }
        "demo" => {
            words.only(0, true, &[])?;
            let place = Place::find()?;
            let elf = build(&place, forced, Edition::Full, "")?.path;
            let out = robot::demo(&place, &elf, &words.rest)?;
            println!("{command}: see {}", place.short(&out));
        }
        "figures" => {
            words.only(0, true, &[])?;
            let place = Place::find()?;
            let hand = build(&place, forced, Edition::Full, robot::HAND)?.path;
            let elf = build(&place, forced, Edition::Full, "")?.path;
            let out = robot::figures(&place, &elf, &hand, &words.rest)?;
            println!("{command}: see {}", place.short(&out));
        }
        "bench" => {
            words.only(0, false, &[])?;
            let place = Place::find()?;
            bench::run(&place, &Arm::find(&place, forced)?)?;
        }
        "robot" => {
            words.only(0, true, &[])?;
            let place = Place::find()?;
            let elf = build(&place, forced, Edition::Full, "")?.path;
            let code = robot::pilot(&place, &elf, &words.rest)?;
            return Ok(ExitCode::from(u8::try_from(code).unwrap_or(1)));
        }
        "flash" | "debug" => flash(command, forced, words)?,
        "test" => {
            let good = test(forced, words)?;
            return Ok(if good {
                ExitCode::SUCCESS
            } else {
                ExitCode::FAILURE
            });
        }
        "prove" => {
            words.only(0, false, &["--shard"])?;
            let shard = words.shard()?;
            let place = Place::find()?;
            if kani::version(&place).is_none() {
                return Err(Error::Missing(kani::MISSING.into()));
            }
            println!("{}", kani::prove(&place, shard)?);
        }
        "fuzz" => {
            words.only(1, false, &["--seconds", "--minimise"])?;
            fuzz(&Place::find()?, words)?;
        }
        "mutants" => {
            mutants(&Place::find()?, words)?;
        }
        "coverage" => {
            words.only(0, false, &[])?;
            coverage::run(&Place::find()?)?;
        }
        "trace" => {
            words.only(0, false, &[])?;
            trace::print(&trace::trace(&Place::find()?)?);
        }
        "defects" => {
            words.only(0, false, &["--only"])?;
            let place = Place::find()?;
            let arm = Arm::find(&place, forced).ok();
            defects::run(&place, arm, &words.list("--only"))?;
        }
        "help" | "--help" | "-h" => print!("{USAGE}"),
        "" => return Err(Error::Usage(format!("no command\n\n{USAGE}"))),
        other => return Err(Error::Usage(format!("unknown command {other}\n\n{USAGE}"))),
    }
    Ok(ExitCode::SUCCESS)
}

fn build(
    place: &Place,
    forced: Option<Way>,
    edition: Edition,
    features: &str,
) -> Result<firmware::Image> {
    let arm = Arm::find(place, forced)?;
    firmware::build(place, &arm, edition, features)
}

fn flash(command: &str, forced: Option<Way>, words: &Words) -> Result<()> {
    let options = ["--minimal", "--virtual", "--serial", "--interface"];
    words.only(0, false, &options)?;
    let place = Place::find()?;
    let elf = build(&place, forced, words.edition(), "")?.path;
    let serial = words.option("--serial");
    let interface = words.option("--interface").unwrap_or("stlink");
    let wiring = flash::Wiring { serial, interface };
    match (command, words.flag("--virtual")) {
        ("flash", false) => flash::flash(&elf, &wiring),
        ("flash", true) => flash::flash_virtual(&place, &elf),
        (_, false) => flash::debug(&elf, &wiring),
        (_, true) => flash::debug_virtual(&place, &elf),
    }
}

fn test(forced: Option<Way>, words: &Words) -> Result<bool> {
    words.only(0, false, &["--quick", "--only", "--may-skip"])?;
    let may_skip = words.option("--may-skip");
    let choice = gates::Choice {
        only: words.list("--only"),
        quick: words.flag("--quick"),
        may_skip: may_skip.map(|_| words.list("--may-skip")),
    };
    gates::run(Place::find()?, forced, &choice)
}

fn mutants(place: &Place, words: &Words) -> Result<()> {
    words.only(
        0,
        false,
        &["--file", "--only", "--shard", "--jobs", "--quick"],
    )?;
    let choice = mutants::Choice {
        files: words.list("--file"),
        only: words.list("--only"),
        shard: words.shard()?,
        jobs: words.number("--jobs", 1)?,
        quick: words.flag("--quick"),
    };
    mutants::run(place, &choice)
}

fn print_stack(place: &Place, forced: Option<Way>, words: &Words) -> Result<()> {
    let features = words.option("--features").unwrap_or("");
    let elf = build(place, forced, words.edition(), features)?.path;
    let bytes = std::fs::read(&elf).of(elf.display())?;
    println!("{}", stack::worst_case(&bytes)?);
    Ok(())
}

fn fuzz(place: &Place, words: &Words) -> Result<()> {
    let seconds = words.number("--seconds", 60)?;
    let fuzzer = Fuzzer::find(place)?;
    let all = fuzzer.targets()?;
    let chosen = match words.plain.first() {
        None => all,
        Some(name) if all.contains(name) => vec![name.clone()],
        Some(name) => {
            return Err(Error::Usage(format!(
                "no fuzz target {name}; there are {}",
                all.join(", ")
            )))
        }
    };
    fuzzer.build()?;
    if words.flag("--minimise") {
        for target in &chosen {
            let (before, now) = fuzzer.minimise(target)?;
            println!("{target}: {before} inputs before, {now} now");
        }
        return Ok(());
    }
    let mut broken = Vec::new();
    for (target, ran) in fuzzer.run_all(&chosen, Effort::Seconds(seconds)) {
        match ran {
            Ok(figures) => println!("{target}: {figures}"),
            Err(error) => broken.push(error.to_string()),
        }
    }
    if broken.is_empty() {
        Ok(())
    } else {
        failed(broken.join("; "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(command: &str, text: &str) -> Result<Words> {
        Words::parse(command, text.split_whitespace().map(str::to_owned))
    }

    #[test]
    fn names_may_be_parted_by_commas_or_given_one_by_one() {
        let words = words("mutants", "--file a,b --quick --file=c").unwrap();
        assert_eq!(words.list("--file"), ["a", "b", "c"]);
        assert!(words.flag("--quick"));
        assert!(words.list("--only").is_empty());
    }

    #[test]
    fn an_unknown_option_or_one_without_its_value_is_refused() {
        for wrong in ["--flie a", "--file"] {
            assert!(matches!(words("mutants", wrong), Err(Error::Usage(_))));
        }
        // These are another program's words.
        assert!(words("demo", "--seed 3").is_ok());
    }
}
